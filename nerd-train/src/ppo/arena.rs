//! The simulator that a policy acts in: a truth, or a model of one.

#[cfg(feature = "cuda")]
use nerd_sim::articulated::device::Real;
use nerd_sim::{rig::LATEST, vary};

use super::*;
use crate::device::Device;
#[cfg(feature = "cuda")]
use crate::learner::cuda::Precision;

/// Makes a solver of the caller's own for a system in a scene.
pub type Make = dyn Fn(&Arc<System>, &Arc<Scene>) -> Result<Box<dyn Solver>> + Send + Sync;

/// What episodes run on.
#[derive(Clone)]
pub enum Arena {
    /// A solver that models are learned from.
    Truth(Truth),
    /// A learned one.
    Model {
        /// The model's folder.
        folder: PathBuf,
        /// Where its network is computed.
        device: Device,
    },
    /// A truth, with robots of a family ([`vary`]) in place of the task's, in each environment another one for good; on a GPU in 32 bits.
    Family(Truth, Arc<System>, Device),
    /// An analytic solver that is not a truth. The reference simulator's preset acts on its own robot, `NAME-paper`.
    Judge(Setting),
    /// An analytic solver that keeps its batch on a GPU.
    #[cfg(feature = "cuda")]
    Card(Setting),
    /// A solver of the caller's own, by its name.
    Guest(String, Arc<Make>),
}

impl Arena {
    /// The truth of a family for a task.
    ///
    /// # Errors
    /// If nothing of it is drawn, it is of another robot than the task, or the truth is not on that device.
    pub fn family(task: &str, name: &str, truth: Truth, device: Device) -> Result<Self> {
        device.check()?;
        if device != Device::Cpu && !(device.is_cuda() && truth == Truth::Articulated) {
            refuse!("--device {device}: robots that differ are on the CPU, and of `articulated` on `cuda`");
        }
        let task = named(task)?;
        let family = task.fit(System::named(name)?)?;
        if family.spec.vary.is_none() {
            refuse!("nothing of `{name}` is drawn; give its TOML a [vary]");
        }
        match family.alike(&*task.system()?) {
            Ok(()) => Ok(Self::Family(truth, family, device)),
            Err(reason) => refuse!("`{name}` is no family of `{}`, which {} is a task of: {reason}", task.robot(), task.name()),
        }
    }

    /// In a word, for a folder's name.
    pub fn word(&self) -> String {
        match self {
            Self::Truth(truth) => format!("{truth:?}").to_lowercase(),
            Self::Family(_, family, device) => family.name.clone() + if device.is_cuda() { "-cuda" } else { "" },
            Self::Model { .. } => "neural".into(),
            Self::Judge(setting) => setting.to_string().replace(' ', "-"),
            #[cfg(feature = "cuda")]
            Self::Card(setting) => setting.to_string().replace(' ', "-") + "-cuda",
            Self::Guest(name, _) => name.to_lowercase(),
        }
    }

    /// In words that tell it from any other, settings and all.
    pub fn title(&self) -> Result<String> {
        Ok(match self {
            Self::Truth(truth) => truth.name(),
            Self::Family(truth, family, device) => {
                format!("{}{} of {}", truth.name(), if device.is_cuda() { " in 32 bits" } else { "" }, family.name)
            }
            Self::Model { folder, .. } => format!("neural {} of {}", folder.display(), ModelConfig::read(folder)?.truth),
            Self::Judge(setting) => setting.to_string(),
            #[cfg(feature = "cuda")]
            Self::Card(setting) => format!("{setting} in 32 bits"),
            Self::Guest(name, _) => name.clone(),
        })
    }

    /// What it computes, by content: robot, truth or model, whatever their folder is called.
    pub fn identity(&self, system: &System) -> Result<String> {
        let system = if let Self::Family(_, family, _) = self { family } else { system };
        let solver = match self {
            Self::Truth(truth) => truth.name(),
            Self::Model { folder, .. } => {
                let ModelConfig { truth, model_sha256, .. } = ModelConfig::read(folder)?;
                format!("model {} of {truth}", model_sha256.get(..16).unwrap_or("without a hash"))
            }
            _ => self.title()?,
        };
        Ok(format!("{solver}, robot {} {}", system.name, &system.sha256()[..16]))
    }

    /// Whether a step is dear: where small settings pay.
    pub fn dear(&self) -> bool {
        matches!(self, Self::Model { device: Device::Cpu, .. })
    }

    /// Whether a GPU takes part, on which policies answer and learn, too.
    pub fn on_gpu(&self) -> bool {
        match self {
            Self::Model { device, .. } | Self::Family(.., device) => device.is_cuda(),
            #[cfg(feature = "cuda")]
            Self::Card(_) => true,
            _ => false,
        }
    }

    /// `n` episodes of a task.
    pub fn episodes(&self, task: &str, n: usize, seed: u64) -> Result<Episodes> {
        self.begin(named(task)?, n, seed)
    }

    /// Settings of a task by PPO: of a file, those called `small` or `paper`, or by what a step here costs.
    pub fn settings(&self, task: &str, recipe: Option<&str>, file: Option<&Path>) -> Result<PpoConfig> {
        if let Some(path) = file {
            let text = nerd_sim::files::read_text(path).map_err(Error::file(path))?;
            return PpoConfig::from_text(&text).map_err(Error::file(path));
        }
        match recipe {
            Some("small") => PpoConfig::small(task),
            // Tasks of a file's own have no run of the paper's to be like.
            None if self.dear() || !(self.on_gpu() || nerd_tasks::names().contains(&task)) => PpoConfig::small(task),
            _ => PpoConfig::of(task),
        }
    }

    /// A run of a task, built-in or not, from random weights, with its policy where the episodes are.
    pub fn trainer(&self, task: Box<dyn Task>, config: PpoConfig, seed: u64) -> Result<Trainer> {
        let episodes = self.begin(task, config.environments, seed)?;
        #[allow(unused_mut)]
        let mut trainer = Trainer::new(episodes, config, seed)?;
        #[cfg(feature = "cuda")]
        if self.on_gpu() {
            let Trainer { episodes, config, state: State { policy, .. }, .. } = &mut trainer;
            let mut engine = || -> Result<Box<dyn Engine>> {
                Ok(match config.algorithm {
                    Algorithm::Ppo => Box::new(CudaEngine::new(&policy.shape, config)?),
                    Algorithm::Shac => Box::new(CudaShac::new(Shac::new(episodes, policy, config, seed)?, policy, config)?),
                })
            };
            trainer.engine = engine().map_err(|e| Error::Refused(format!("--device cuda: {e}")))?;
        }
        Ok(trainer)
    }

    /// `n` episodes of a task that need not be built in.
    pub fn begin(&self, task: Box<dyn Task>, n: usize, seed: u64) -> Result<Episodes> {
        let system = match self {
            Self::Judge(Setting::Paper) => System::named(&format!("{}-paper", task.robot()))?,
            Self::Family(_, family, _) => family.clone(),
            _ => task.system()?,
        };
        if n == 0 {
            refuse!("at least one environment is needed");
        }
        let batch = match self {
            // From other streams than the episodes.
            Self::Family(..) => vary::batch(&system, task.scene(), n, !seed)?,
            _ => Batch::new(&system, &system.scene(task.scene())?, n),
        };
        // And how many frames back its next step depends on.
        let (solver, memory): (Box<dyn Solver>, usize) = match self {
            Self::Truth(truth) => (truth.solver(&system), 0),
            #[cfg(feature = "cuda")]
            Self::Family(.., device) if device.is_cuda() => {
                (crate::device::resident(&Setting::Accurate, &system, Real::F32, Precision::F16)?, LATEST as usize + 1)
            }
            Self::Family(truth, ..) => (truth.solver(&system), LATEST as usize + 1),
            Self::Model { folder, device } => {
                let model = Model::load(folder, &system, None)?;
                let reach = model.config.network.reach();
                (device.solver(model, &system, n)?, reach)
            }
            Self::Judge(setting) => (setting.solver(&system)?, 0),
            #[cfg(feature = "cuda")]
            Self::Card(setting) => (crate::device::resident(setting, &system, Real::F32, Precision::F16)?, 0),
            Self::Guest(_, make) => (make(&system, &batch.scenes[0])?, 0),
        };
        let mut episodes = Episodes::new(task, Simulation { batch, solver }, seed);
        episodes.remember(memory);
        Ok(episodes)
    }
}
