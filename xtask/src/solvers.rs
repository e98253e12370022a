//! Solvers by their names on the command line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_sim::prelude::*;

use crate::common::Device;

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
    /// Substeps a frame, in place of the preset's
    #[arg(long)]
    pub substeps: Option<usize>,
    /// Folder of the model of `neural` [default: models/ROBOT]
    #[arg(long)]
    pub model: Option<PathBuf>,
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
            model: None,
            device: Device::Flex,
        }
    }
}

/// Makes the solver for `n` environments of `system`.
pub fn build(args: &SolverArgs, system: &Arc<System>, n: usize) -> Result<Box<dyn Solver>> {
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
            let truth = format!("articulated {preset} {law}");
            let folder = args.model.clone().unwrap_or_else(|| shipped(&system.name));
            Box::new(neural(&folder, system, Some(&truth), args.device, n)?)
        }
    })
}

/// The solver that a model's card calls its truth.
pub fn truth(name: &str, system: &Arc<System>) -> Result<Box<dyn Solver>> {
    match name {
        crate::train::TRUTH => Ok(crate::train::truth(system)),
        _ => bail!("no truth is called `{name}`; known is `{}`", crate::train::TRUTH),
    }
}

/// Folder of the model that comes with the project.
pub fn shipped(robot: &str) -> PathBuf {
    Path::new("models").join(robot)
}

/// A model as a solver for `n` environments.
pub fn neural(folder: &Path, system: &Arc<System>, truth: Option<&str>, device: Device, n: usize) -> Result<Neural> {
    let model = Model::load(folder, system, truth)?;
    let network = crate::train::network(&model.weights, device, n)?;
    Ok(Neural::new(model, system, network))
}
