//! A solver by its description, as on the command line or in an experiment's settings; it is built once robot and scene are known.

use nerd_model::{base::Base, form::View, transformer::Architecture};

use crate::prelude::*;

#[derive(Clone, Debug, PartialEq)]
pub enum Choice {
    Setting(Setting),
    /// `articulated` at settings that may have no such name.
    Articulated(ArticulatedConfig),
    /// A model, which must have learned `truth` if one is asked for.
    Neural {
        folder: PathBuf,
        truth: Option<String>,
        device: Device,
    },
}

impl Choice {
    /// A model, whatever truth it learned, on the CPU.
    pub fn model(folder: impl Into<PathBuf>) -> Self {
        Self::Neural { folder: folder.into(), truth: None, device: Device::Cpu }
    }

    /// The same as a setting, where it is one.
    pub fn setting(&self, system: &System) -> Option<Setting> {
        match self {
            Self::Setting(setting) => Some(setting.clone()),
            Self::Neural { folder, .. } => Some(Setting::Neural(folder.clone())),
            Self::Articulated(config) => {
                let n = config.contact_substeps;
                let known = [Setting::Accurate, Setting::Paper, Setting::Implicit(n), Setting::Euler(n), Setting::Rk4(config.substeps)];
                known.into_iter().find(|s| s.articulated(system).as_ref() == Some(config))
            }
        }
    }

    pub fn title(&self, system: &System) -> Result<String> {
        Ok(match (self, self.setting(system)) {
            (Self::Neural { folder, .. }, _) => describe(&ModelConfig::read(folder)?),
            (_, Some(setting)) => setting.to_string(),
            (Self::Articulated(config), None) => {
                format!("articulated x{}", config.contact_substeps)
            }
            (Self::Setting(_), None) => String::new(),
        })
    }

    pub fn learned(&self) -> Result<Option<Truth>> {
        let Self::Neural { folder, .. } = self else { return Ok(None) };
        Ok(Some(ModelConfig::truth_of(folder)?))
    }

    /// Whether it moves as that truth does in a scene, by its settings.
    pub fn is(&self, truth: Truth, system: &System, scene: &Scene) -> bool {
        let ours = match self {
            Self::Articulated(config) => Some(*config),
            _ => self.setting(system).and_then(|setting| setting.articulated(system)),
        };
        let contact = system.held() || !scene.colliders.is_empty() && !system.robot.contact_points.is_empty();
        match (ours, Setting::from(truth).articulated(system)) {
            (Some(ours), Some(theirs)) => ours.moves_as(&theirs, contact),
            _ => self.setting(system) == Some(truth.into()),
        }
    }

    /// Substeps of a frame, as far as they are known before it is made.
    pub fn substeps(&self) -> usize {
        match self {
            Self::Articulated(config) => config.substeps.max(config.contact_substeps),
            Self::Setting(Setting::RapierSteps(n) | Setting::RapierOwn(n)) => n.saturating_mul(RapierConfig::default().iterations),
            Self::Setting(setting) => setting.substeps().unwrap_or(1),
            Self::Neural { .. } => 1,
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

    pub fn build(&self, system: &Arc<System>, n: usize) -> Result<Box<dyn Solver>> {
        Ok(match self {
            Self::Setting(setting) => setting.solver(system)?,
            Self::Articulated(config) => Box::new(Articulated::new(*config)),
            Self::Neural { folder, truth, device } => device.neural(folder, system, truth.as_deref(), n)?,
        })
    }
}

/// Form and size of a model, for tables and legends.
pub fn describe(model: &ModelConfig) -> String {
    let form = match model.network.architecture {
        Architecture::Chain => "along the chain",
        Architecture::Transformer if model.base == Base::State && model.view == View::Own => "paper's form",
        _ => "pure",
    };
    format!("NeRD {form}, {:.2} M", model.network.parameters() as f64 / 1e6)
}
