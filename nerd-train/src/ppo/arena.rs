//! The solver that a policy trains or plays in: a truth, a learned model, or another solver.

use nerd_sim::{rig::LATEST, vary};

use super::*;
use crate::device::Device;
use crate::files::read_text;
use crate::shipped;
use crate::spec::{NeuralSpec, SolverSpec};

/// Makes a caller's solver for a system in a scene.
pub type Make = dyn Fn(&Arc<System>, &Arc<Scene>) -> Result<Box<dyn Solver>> + Send + Sync;

/// Solver that steps the episodes of a policy.
#[derive(Clone)]
pub enum Arena {
    /// A solver given by its text form; it steps the task's robot.
    Solver(SolverSpec),
    /// The truth `paper`: the reference simulator's method, on the variant `NAME-paper` of the robot.
    Reference(SolverSpec),
    /// A solver with robots that differ: each environment keeps one robot drawn from a family ([`vary`]).
    Family(SolverSpec, Arc<System>),
    /// A solver that the caller makes, and its name.
    Guest(String, Arc<Make>),
}

impl From<Truth> for Arena {
    fn from(truth: Truth) -> Self {
        if truth == Truth::Paper { Self::Reference(truth.into()) } else { Self::Solver(truth.into()) }
    }
}

impl Arena {
    /// The arena of a task. The solver `neural` without a folder takes the model shipped for the task, or else for its
    /// robot.
    ///
    /// # Errors
    /// If no model is shipped for the task or its robot, or this build lacks the device.
    pub fn of(spec: SolverSpec, task: &dyn Task) -> Result<Self> {
        spec.device().check()?;
        let SolverSpec::Neural(NeuralSpec { folder: None, device }) = spec else { return Ok(Self::Solver(spec)) };
        let folder = shipped::model_of_task(task.name(), &task.system()?.name);
        if !folder.join("config.json").exists() {
            refuse!("{}: there is no model: train one (`cargo xtask train`), name one with --model", folder.display());
        }
        Ok(Self::Solver(SolverSpec::neural(folder).on(device)))
    }

    /// The arena of a task with robots drawn from the family `name`.
    ///
    /// # Errors
    /// If the family draws no parameter or belongs to another robot than the task's. Also if the solver cannot step
    /// robots that differ.
    pub fn family(task: &str, name: &str, solver: SolverSpec) -> Result<Self> {
        let device = solver.device();
        device.check()?;
        if solver.is_neural()
            || !(device == Device::Cpu || device.is_cuda() && solver == SolverSpec::default().on(device))
        {
            refuse!(
                "{solver}: robots that differ are stepped by analytic solvers on the CPU, and on cuda by `articulated` without settings"
            );
        }
        let task = named(task)?;
        let family = task.fit(System::named(name)?)?;
        if family.spec.vary.is_none() {
            refuse!("nothing of `{name}` is drawn; give its TOML a [vary]");
        }
        match family.alike(&*task.system()?) {
            Ok(()) => Ok(Self::Family(solver, family)),
            Err(reason) => {
                refuse!("`{name}` is no family of `{}`, which {} is a task of: {reason}", task.robot(), task.name())
            }
        }
    }

    /// Short name of the solver, for folder names.
    pub fn word(&self) -> String {
        match self {
            Self::Solver(SolverSpec::Neural(_)) => "neural".into(),
            Self::Solver(spec) | Self::Reference(spec) => dashed(spec),
            Self::Family(spec, family) => format!("{}-{}", family.name, dashed(spec)),
            Self::Guest(name, _) => name.to_lowercase(),
        }
    }

    /// Full name of the solver, with all its settings.
    pub fn title(&self) -> Result<String> {
        Ok(match self {
            Self::Solver(spec) | Self::Reference(spec) => match spec.folder() {
                Some(folder) => format!("{spec} of {}", ModelConfig::read(folder)?.truth),
                None => spec.to_string(),
            },
            Self::Family(spec, family) => format!("{spec} of {}", family.name),
            Self::Guest(name, _) => name.clone(),
        })
    }

    /// Identity by content: hashes of robot and model, so that folder names do not matter.
    pub fn identity(&self, system: &System) -> Result<String> {
        let system = if let Self::Family(_, family) = self { family } else { system };
        let solver = match self.spec().and_then(SolverSpec::folder) {
            Some(folder) => {
                let ModelConfig { truth, model_sha256, .. } = ModelConfig::read(folder)?;
                format!("model {} of {truth}", model_sha256.get(..16).unwrap_or("without a hash"))
            }
            None => self.title()?,
        };
        Ok(format!("{solver}, robot {} {}", system.name, &system.sha256()[..16]))
    }

    /// Text form of the solver; `None` for a solver that the caller makes.
    pub fn spec(&self) -> Option<&SolverSpec> {
        match self {
            Self::Solver(spec) | Self::Reference(spec) | Self::Family(spec, _) => Some(spec),
            Self::Guest(..) => None,
        }
    }

    /// Whether steps are slow, so that [`PpoConfig::small`] trains faster: a learned model on the CPU.
    pub fn expensive(&self) -> bool {
        matches!(self, Self::Solver(SolverSpec::Neural(own)) if own.device == Device::Cpu)
    }

    /// Whether the solver runs on a GPU; policy and updates then run there too.
    pub fn on_gpu(&self) -> bool {
        self.spec().is_some_and(|spec| spec.device().is_cuda())
    }

    /// `n` episodes of a task.
    pub fn episodes(&self, task: &str, n: usize, seed: u64) -> Result<Episodes> {
        self.begin(named(task)?, n, seed)
    }

    /// PPO settings of a task: from `file`, or else by the name `small` or `paper` in `recipe`. Without both, slow
    /// solvers ([`Self::expensive`]) get the small settings, and so do tasks from files on the CPU. All others get the
    /// paper's settings.
    pub fn settings(&self, task: &str, recipe: Option<&str>, file: Option<&Path>) -> Result<PpoConfig> {
        if let Some(path) = file {
            return PpoConfig::from_text(&read_text(path)?).map_err(Error::file(path));
        }
        match recipe {
            Some("small") => PpoConfig::small(task),
            // The paper has no run of a task from a file to reproduce.
            None if self.expensive() || !(self.on_gpu() || nerd_tasks::names().contains(&task)) => {
                PpoConfig::small(task)
            }
            _ => PpoConfig::of(task),
        }
    }

    /// A training run of a task, built-in or not, from random weights. The policy runs on the GPU if the solver does.
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
                    Algorithm::Shac => {
                        Box::new(CudaShac::new(Shac::new(episodes, policy, config, seed)?, policy, config)?)
                    }
                })
            };
            trainer.engine = engine().map_err(|e| format!("--device cuda: {e}"))?;
        }
        Ok(trainer)
    }

    /// `n` episodes of a task, built-in or not.
    pub fn begin(&self, task: Box<dyn Task>, n: usize, seed: u64) -> Result<Episodes> {
        let system = match self {
            Self::Family(_, family) => family.clone(),
            Self::Reference(_) => match task.system()? {
                own if own.spec.truth == Truth::Paper => own,
                _ => System::named(&format!("{}-paper", task.robot()))?,
            },
            _ => task.system()?,
        };
        if n == 0 {
            refuse!("at least one environment is needed");
        }
        let batch = match self {
            // Draw robot parameters from the inverted seed, so that they share no random stream with the episodes.
            Self::Family(..) => vary::batch(&system, task.scene(), n, !seed)?,
            _ => Batch::new(&system, &system.scene(task.scene())?, n),
        };
        // `memory` is the number of past frames that the next step depends on.
        let (solver, memory) = match self {
            Self::Solver(spec) | Self::Reference(spec) => {
                let spec = spec.clone().found(&system)?;
                let reach = match spec.folder() {
                    Some(folder) => Model::load(folder, &system, None)?.config.network.reach(),
                    None => 0,
                };
                (spec.solver(&system, n)?, reach)
            }
            Self::Family(spec, _) => (spec.solver(&system, n)?, LATEST as usize + 1),
            Self::Guest(_, make) => (make(&system, &batch.scenes[0])?, 0),
        };
        let mut episodes = Episodes::new(task, Simulation { batch, solver }, seed);
        episodes.remember(memory);
        Ok(episodes)
    }
}

/// A solver's text in letters, digits and dashes.
fn dashed(spec: &SolverSpec) -> String {
    spec.to_string().split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).join("-")
}
