//! Options that name and configure a solver, and their valid combinations.

use anyhow::anyhow;
use nerd_model::pick::Setting;
use nerd_train::shipped;

use crate::options::{MODELS, SUBSTEPS, TRUTHS};
use crate::prelude::*;

#[derive(clap::Args, Clone, Debug, Default, PartialEq)]
pub struct SolverArgs {
    /// Solver: articulated, rapier or neural [default: articulated]
    #[arg(long, value_enum)]
    pub solver: Option<SolverName>,
    /// Settings of `articulated`: `accurate` (what models learn), `paper` (the reference simulator's, for robots NAME-paper) or
    /// `converged` (as accurate as can be) [default: that of the robot's own truth]
    #[arg(long, value_parser = ["accurate", "paper", "converged"])]
    pub preset: Option<String>,
    /// Substeps per frame, instead of the preset's; with `--preset converged` of the implicit step (of RK4 where there is
    /// nothing to touch), of `rapier` its iterations
    #[arg(long, value_parser = value::<usize>(Whole(SUBSTEPS)))]
    pub substeps: Option<usize>,
    /// Truth that the model of `neural` must have learned, and that `evaluate` compares a solver with [default: the
    /// model's, else the robot's own]
    #[arg(long, value_parser = word::<Truth>(TRUTHS))]
    pub truth: Option<Truth>,
    /// Folder of the model of `neural` [default: models/ROBOT, with --truth rapier models/ROBOT-rapier]
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Where `neural` is computed [default: cpu]
    #[arg(long, value_parser = word::<Device>(MODELS))]
    pub device: Option<Device>,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverName {
    /// Our own articulated dynamics.
    Articulated,
    /// rapier's multibody joints.
    Rapier,
    /// A learned model.
    Neural,
}

impl SolverArgs {
    /// The solver that the options name; refuses one that means nothing beside the others.
    pub fn choose(&self, system: &System) -> Result<Choice> {
        let (model, device) = (("--model", self.model.is_some()), ("--device", self.device.is_some()));
        let (preset, substeps) = (("--preset", self.preset.is_some()), ("--substeps", self.substeps.is_some()));
        if let Some(truth) = self.truth {
            truth.check(&system.robot, system.spec.self_collision).map_err(|e| anyhow!("--truth: {e}"))?;
        }
        let solver = self.solver.unwrap_or(SolverName::Articulated);
        if solver != SolverName::Neural {
            unused(&[model, device], "without --solver neural")?;
        }
        Ok(match solver {
            SolverName::Articulated => {
                let own = if system.spec.truth == Truth::Paper { "paper" } else { "accurate" };
                if self.preset.as_deref() == Some("paper") {
                    Truth::Paper.check(&system.robot, system.spec.self_collision).map_err(|e| anyhow!("--preset paper: {e}"))?;
                }
                let mut config = match self.preset.as_deref().unwrap_or(own) {
                    "accurate" => ArticulatedConfig::accurate(system),
                    "paper" => ArticulatedConfig::paper(system, Friction::Coulomb),
                    _ => ArticulatedConfig::converged(Friction::Coulomb),
                };
                if let Some(n) = self.substeps {
                    (config.substeps, config.contact_substeps) = (n, n);
                }
                Choice::Articulated(config)
            }
            SolverName::Rapier => {
                unused(&[preset], "with --solver rapier: it sets `articulated`")?;
                Choice::Setting(self.substeps.map_or(Setting::RapierSteps(RapierConfig::default().steps), Setting::Rapier))
            }
            SolverName::Neural => {
                unused(&[substeps, preset], "with --solver neural; --truth says what its model must have learned")?;
                let shipped = || shipped::model(self.truth.unwrap_or(system.spec.truth), &system.name);
                let folder = self.model.clone().unwrap_or_else(shipped);
                if self.model.is_none() && !folder.exists() {
                    anyhow::bail!(
                        "no model of `{}` comes with the project ({}): train one, and name it with --model",
                        system.name,
                        folder.display()
                    );
                }
                Choice::Neural { folder, truth: self.truth.map(Truth::name), device: self.device.unwrap_or_default() }
            }
        })
    }
}
