//! Solvers by their names on the command line.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::neural::Neural;
use nerd_model::pick::{Setting, pick};
use nerd_sim::prelude::*;
use nerd_train::shipped::results;

mod args;

pub use args::{SolverArgs, SolverName};

use crate::common::Device;
use crate::truth::Truth;

/// A solver with its settings.
#[derive(Clone, Debug)]
pub enum Choice {
    /// `articulated`.
    Articulated(ArticulatedConfig),
    /// `rapier`.
    Rapier(RapierConfig),
    /// A model, of a certain truth if one is named.
    Neural { folder: PathBuf, truth: Option<String>, device: Device },
    /// The cheapest that a scene's chart found to be so near.
    Within(f64),
    /// What was found.
    Picked(Setting),
}

impl Choice {
    /// The solver for one scene: where a chart is to be asked, what it says.
    pub fn in_scene(&self, system: &System, scene: &str) -> Result<Self> {
        let Self::Within(tolerance) = self else { return Ok(self.clone()) };
        let picked = pick(&results(), &system.name, scene, *tolerance)?;
        eprintln!("{:?}: {:.2} us a frame for {:.2e}", picked.setting, picked.microseconds, picked.error);
        Ok(Self::Picked(picked.setting))
    }

    /// The solver in a table.
    pub fn title(&self) -> Result<String> {
        Ok(match self {
            Self::Articulated(_) => "articulated".into(),
            Self::Rapier(_) => "rapier".into(),
            Self::Neural { folder, .. } => describe(&ModelConfig::read(folder)?),
            Self::Within(tolerance) => format!("within {tolerance}"),
            Self::Picked(setting) => format!("{setting:?}"),
        })
    }

    /// The truth that it learned, if it learned one.
    pub fn learned(&self) -> Result<Option<Truth>> {
        match self {
            Self::Neural { folder, .. } => Ok(Some(ModelConfig::truth_of(folder)?)),
            _ => Ok(None),
        }
    }

    /// Whether it is that truth itself, to the last setting.
    pub fn is(&self, truth: Truth, system: &System) -> bool {
        match self {
            Self::Articulated(config) => truth == Truth::Articulated && *config == ArticulatedConfig::paper(system, Friction::Coulomb),
            Self::Picked(setting) => truth == Truth::Articulated && *setting == Setting::Paper,
            Self::Rapier(config) => truth == Truth::Rapier && *config == Truth::rapier(),
            Self::Neural { .. } | Self::Within(_) => false,
        }
    }

    /// Substeps of a frame, as far as they are known before it is made.
    pub fn substeps(&self) -> usize {
        match self {
            Self::Articulated(config) => config.substeps.max(config.contact_substeps),
            Self::Rapier(config) => config.steps.saturating_mul(config.iterations),
            Self::Picked(setting) => setting.substeps().unwrap_or(1),
            Self::Neural { .. } | Self::Within(_) => 1,
        }
    }

    /// Bytes that it keeps of an environment, beside the batch.
    pub fn bytes(&self) -> Result<usize> {
        let Self::Neural { folder, .. } = self else { return Ok(0) };
        let network = ModelConfig::read(folder)?.network;
        // Tokens of a window, and keys and values of every layer.
        let token = network.inputs.saturating_add(network.layers.saturating_mul(network.embedding).saturating_mul(2));
        Ok(network.history.saturating_mul(token).saturating_mul(8))
    }

    /// Makes the solver for `n` environments of `system` in `scene`.
    pub fn build(&self, system: &Arc<System>, scene: &str, n: usize) -> Result<Box<dyn Solver>> {
        Ok(match self {
            Self::Articulated(config) => Box::new(Articulated::new(*config)),
            Self::Rapier(config) => Box::new(Rapier::new(*config)),
            Self::Neural { folder, truth, device } => Box::new(neural(folder, system, truth.as_deref(), *device, n)?),
            Self::Within(_) => self.in_scene(system, scene)?.build(system, scene, n)?,
            Self::Picked(setting) => setting.solver(system)?,
        })
    }
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
