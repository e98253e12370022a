//! Options that name and configure a solver.

use nerd_train::spec::{Method, NeuralSpec, RapierSpec, SolverSpec};

use crate::options::{MODELS, SUBSTEPS, TRUTHS};
use crate::prelude::*;

#[derive(clap::Args, Clone, Default, PartialEq)]
pub struct SolverArgs {
    /// Solver: articulated, rapier or neural, with settings in brackets. Examples: 'articulated(substeps=4,
    /// method=euler)', 'rapier(steps=8, iterations=4, axes=world)', 'neural(models/ant, cuda)' [default: the robot's
    /// truth]
    #[arg(long, value_parser = spec)]
    pub solver: Option<SolverSpec>,
    /// Substeps per frame, as in 'articulated(substeps=N)'. For rapier: its steps per frame [default: as in --solver]
    #[arg(long, value_parser = value::<usize>(Whole(SUBSTEPS)))]
    pub substeps: Option<usize>,
    /// Truth that the model of `neural` must have learned: articulated, paper or rapier. `evaluate` measures errors
    /// from this solver [default: the model's, else the robot's]
    #[arg(long, value_parser = word::<Truth>(TRUTHS))]
    pub truth: Option<Truth>,
    /// Folder of the model of `neural`, as in 'neural(FOLDER)' [default: models/ROBOT, with --truth rapier
    /// models/ROBOT-rapier]
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Device of the solver, as in 'neural(FOLDER, cuda)': cpu, cuda (NVIDIA GPU) or cuda-f32 (NVIDIA GPU with f32
    /// matrix products) [default: cpu]
    #[arg(long, value_parser = word::<Device>(MODELS))]
    pub device: Option<Device>,
}

/// Parses the value of --solver; the error is text.
pub fn spec(text: &str) -> Result<SolverSpec, String> {
    text.parse().map_err(|e: nerd_train::Error| e.to_string())
}

/// Sets the model's folder to that of --model; refuses a second folder in --solver.
pub fn choose_folder(own: &mut NeuralSpec, model: &Option<PathBuf>) -> Result<()> {
    if own.folder.is_some() && model.is_some() {
        bail!("--model: --solver names a folder, too; leave one out");
    }
    own.folder = model.clone().or(own.folder.take());
    Ok(())
}

/// Returns the device of --device, or else that of --solver; refuses two that differ.
pub fn device_of(asked: Option<Device>, own: Device) -> Result<Device> {
    match asked {
        Some(asked) if own != Device::Cpu && own != asked => {
            bail!("--device {asked}: --solver says {own}; leave one out")
        }
        asked => Ok(asked.unwrap_or(own)),
    }
}

impl SolverArgs {
    /// Whether the solver is a model.
    pub fn neural(&self) -> bool {
        matches!(self.solver, Some(SolverSpec::Neural(_)))
    }

    /// Returns the solver that the options name; refuses options that have no effect on it.
    pub fn choose(&self, system: &System) -> Result<SolverSpec> {
        let model = ("--model", self.model.is_some());
        let device = ("--device", self.device.is_some());
        let substeps = ("--substeps", self.substeps.is_some());
        if let Some(truth) = self.truth {
            truth.check(&system.robot, system.spec.self_collision).map_err(|e| anyhow!("--truth: {e}"))?;
        }
        let mut spec = self.solver.clone().unwrap_or_else(|| system.spec.truth.into());
        match &mut spec {
            SolverSpec::Articulated(own) => {
                unused(&[model], "without --solver neural")?;
                own.device = device_of(self.device, own.device)?;
                own.substeps = self.steps(own.substeps)?.or(own.substeps);
                if own.method == Method::Paper {
                    Truth::Paper
                        .check(&system.robot, system.spec.self_collision)
                        .map_err(|e| anyhow!("method=paper: {e}"))?;
                }
            }
            SolverSpec::Rapier(own) => {
                unused(&[model, device], "without --solver neural")?;
                let named = Some(own.steps).filter(|steps| *steps != RapierSpec::default().steps);
                own.steps = self.steps(named)?.unwrap_or(own.steps);
            }
            SolverSpec::Neural(own) => {
                unused(&[substeps], "with --solver neural; --truth says what its model must have learned")?;
                own.device = device_of(self.device, own.device)?;
                choose_folder(own, &self.model)?;
                if let (None, Some(truth)) = (&own.folder, self.truth) {
                    let folder = nerd_train::shipped::model(truth, &system.name);
                    if !folder.exists() {
                        bail!(
                            "no model of `{}` with this truth comes with the project ({}): name one with --model",
                            system.name,
                            folder.display()
                        );
                    }
                    own.folder = Some(folder);
                }
            }
        }
        let spec = spec.found(system)?;
        if let (Some(truth), Some(folder)) = (self.truth, spec.folder()) {
            // Refuses a model that learned another truth.
            nerd_model::folder::Model::load(folder, &Arc::new(system.clone()), Some(&truth.name()))?;
        }
        Ok(spec)
    }

    /// Returns --substeps; refuses it if --solver names another number.
    fn steps(&self, named: Option<usize>) -> Result<Option<usize>> {
        match (self.substeps, named) {
            (Some(asked), Some(own)) if asked != own => {
                bail!("--substeps {asked}: --solver says {own}; leave one out")
            }
            (asked, _) => Ok(asked),
        }
    }
}
