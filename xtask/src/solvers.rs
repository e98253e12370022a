//! Solvers by their names on the command line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::neural::Neural;
use nerd_model::pick::pick;
use nerd_sim::prelude::*;

use crate::common::Device;
use crate::truth::Truth;

/// Which solver, and how it is set.
#[derive(clap::Args, Clone, Debug)]
pub struct SolverArgs {
    /// Solver: articulated, rapier or neural
    #[arg(long, value_enum, default_value_t = SolverName::Articulated)]
    pub solver: SolverName,
    /// Settings of `articulated`: `paper` (the reference simulator's) or `converged`
    #[arg(long, value_enum, default_value_t = Preset::Paper)]
    pub preset: Preset,
    /// Friction law of `articulated`: `coulomb` (Warp 1.5.1) or `huber` (Warp 1.8)
    #[arg(long, value_enum, default_value_t = FrictionName::Coulomb)]
    pub friction: FrictionName,
    /// Substeps a frame, in place of the preset's; with `--preset converged` of the implicit step (of RK4 where there is
    /// nothing to touch), of `rapier` its iterations
    #[arg(long)]
    pub substeps: Option<usize>,
    /// Truth that the model of `neural` must have learned, and that `evaluate` holds a solver against [default: the
    /// model's, else articulated]
    #[arg(long, value_enum)]
    pub truth: Option<Truth>,
    /// Folder of the model of `neural` [default: models/ROBOT, with --truth rapier models/ROBOT-rapier]
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// In place of --solver: the cheapest that `results/chart-ROBOT-SCENE.json` found to be at most so far (mean |dq|, rad or m)
    /// from a converged motion
    #[arg(long, value_name = "ERROR")]
    pub tolerance: Option<f64>,
    /// Where `neural` is computed
    #[arg(long, value_enum, default_value_t = Device::Flex)]
    pub device: Device,
}

/// Solvers.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverName {
    /// Our own articulated dynamics.
    Articulated,
    /// rapier's multibody joints.
    Rapier,
    /// A learned model.
    Neural,
}

/// Presets of `articulated`.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// The reference simulator's settings.
    Paper,
    /// The accurate ones.
    Converged,
}

/// Friction laws of `articulated`.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrictionName {
    /// Regularised Coulomb.
    Coulomb,
    /// With the Huber size of the slip.
    Huber,
}

impl Default for SolverArgs {
    /// What the command line has without options.
    fn default() -> Self {
        Self {
            solver: SolverName::Articulated,
            preset: Preset::Paper,
            friction: FrictionName::Coulomb,
            substeps: None,
            truth: None,
            model: None,
            tolerance: None,
            device: Device::Flex,
        }
    }
}

impl SolverArgs {
    /// Folder of the model.
    fn folder(&self, system: &System) -> PathBuf {
        self.model.clone().unwrap_or_else(|| self.truth.unwrap_or_default().shipped(&system.name))
    }

    /// The solver in a table.
    pub fn title(&self, system: &System) -> Result<String> {
        Ok(match (self.tolerance, self.solver) {
            (Some(tolerance), _) => format!("within {tolerance}"),
            (None, SolverName::Neural) => describe(&ModelConfig::read(&self.folder(system))?),
            (None, other) => format!("{other:?}").to_lowercase(),
        })
    }

    /// What the solver is held against.
    pub fn against(&self, system: &System) -> Result<Truth> {
        match self.truth {
            Some(truth) => Ok(truth),
            None if self.solver == SolverName::Neural => Truth::of(&self.folder(system)),
            None => Ok(Truth::default()),
        }
    }
}

/// Makes the solver for `n` environments of `system` in `scene`.
pub fn build(args: &SolverArgs, system: &Arc<System>, scene: &str, n: usize) -> Result<Box<dyn Solver>> {
    if let Some(tolerance) = args.tolerance {
        let picked = pick(Path::new("results"), &system.name, scene, tolerance)?;
        eprintln!("{:?}: {:.2} us a frame for {:.2e}", picked.setting, picked.microseconds, picked.error);
        return Ok(picked.setting.solver(system)?);
    }
    if args.substeps == Some(0) {
        bail!("--substeps 0: at least one is needed");
    }
    let friction = match args.friction {
        FrictionName::Coulomb => Friction::Coulomb,
        FrictionName::Huber => Friction::Huber,
    };
    Ok(match args.solver {
        SolverName::Articulated => {
            let mut config = match args.preset {
                Preset::Paper => ArticulatedConfig::paper(system, friction),
                Preset::Converged => ArticulatedConfig::converged(friction),
            };
            if let Some(n) = args.substeps {
                (config.substeps, config.contact_substeps) = (n, n);
            }
            Box::new(Articulated::new(config))
        }
        SolverName::Rapier => Box::new(Rapier::new(args.substeps.map_or_else(RapierConfig::default, RapierConfig::substeps))),
        SolverName::Neural => {
            let preset = if args.preset == Preset::Paper { "paper" } else { "converged" };
            let law = if args.friction == FrictionName::Coulomb { "coulomb" } else { "huber" };
            // Settings of `articulated`, if any are given, ask for a model that learned from it.
            let asked = format!("articulated {preset} {law}");
            let truth = if asked == Truth::Articulated.name() { args.truth.map(Truth::name) } else { Some(asked) };
            Box::new(neural(&args.folder(system), system, truth.as_deref(), args.device, n)?)
        }
    })
}

/// Form and size of a model, for tables and legends.
pub fn describe(model: &ModelConfig) -> String {
    let form = if model.base.flies() { "on flight" } else { "paper's form" };
    format!("NeRD {form}, {:.2} M", model.network.parameters() as f64 / 1e6)
}

/// A model as a solver for `n` environments.
pub fn neural(folder: &Path, system: &Arc<System>, truth: Option<&str>, device: Device, n: usize) -> Result<Neural> {
    let model = Model::load(folder, system, truth)?;
    let network = crate::train::network(&model.weights, device, n)?;
    Ok(Neural::new(model, system, network))
}
