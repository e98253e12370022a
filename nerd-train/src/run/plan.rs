//! Derives the plan of a run from its settings: form, network, learner, trainer, data to record. All checks happen
//! here, before anything is recorded or written.

use nerd_sim::{dataset::Manifest, log::specified, vary};

use super::*;
use crate::progress;
use crate::schedule::Schedule;
use crate::stop::PATIENCE;

pub(super) struct Plan {
    /// Settings of the run; with a log, robot and number of transitions are the log's.
    pub config: RunConfig,
    pub mode: Mode,
    pub system: Arc<System>,
    pub network: TransformerConfig,
    pub learner: LearnerConfig,
    pub trainer: TrainerConfig,
    pub recording: GenerateConfig,
    /// The log, if recorded motion is the data.
    pub measured: Option<Measured>,
    /// The model to start from; random weights without one.
    pub parent: Option<Model>,
    /// Policies that act in the data, in words; `None` for data from a folder.
    pub actors: Option<String>,
    /// Engine and precision, in words.
    pub arithmetic: String,
}

impl Plan {
    pub fn new(config: &RunConfig) -> Result<Self> {
        let mode = config.check()?;
        let held_out = config.held_out.as_deref().unwrap_or_default();
        let measured = config.log().map(|log| Measured::read(&log, held_out)).transpose()?;
        let system = config.system()?;
        progress::notes(&system);
        let config = &match (&measured, &config.data) {
            (Some(measured), _) => config.of(measured),
            (None, Some(folder)) => {
                let Manifest { trajectories, frames, .. } = Manifest::read(folder)?;
                RunConfig { transitions: trajectories.saturating_mul(frames), ..config.clone() }
            }
            (None, None) => config.clone(),
        };
        let network = mode.network(&system, config.embedding, config.layers)?;
        if mode.form().told && vary::columns(&system).is_empty() {
            refuse!("--condition-on-params: nothing of `{}` is drawn; give its TOML a [vary]", system.name);
        }
        if mode.frames().is_some() && measured.is_none() && system.noisy() {
            refuse!(
                "--sequence rolls out from states as they are, and sensors of `{}` have noise: take --history or --stream",
                system.name
            );
        }
        let learner = config.learner();
        let trainer = config.trainer();
        learner.check().and(trainer.check())?;
        // Fresh data beyond the tokens that the run reads would be wasted.
        let fresh = config.fresh_transitions;
        let batch = learner.batch;
        let sequence = network.sequence();
        let looked_at = u128::from(trainer.updates) * (batch * sequence) as u128;
        if fresh as u128 > looked_at {
            refuse!(
                "--fresh-transitions {fresh}: {} updates of {batch} sequences of {sequence} look at {looked_at} tokens",
                trainer.updates
            );
        }
        memory::check(config, &network)?;
        let mut recording = config.record.of(&system, config.transitions)?;
        // Small shards of fresh data arrive soon, even from a slow truth.
        recording.shard_trajectories = if fresh > 0 { 64 } else { 512 };
        if fresh > 0 {
            recording.transitions =
                recording.transitions.next_multiple_of(recording.frames * recording.shard_trajectories);
        }
        recording.check(&system)?;
        recording.until = Stop::after(Instant::now() + PATIENCE, config.minutes).0;
        let sequence = mode.frames().unwrap_or(1).max(sequence);
        let recorded = config.data.is_none();
        if recorded && sequence > config.record.frames {
            refuse!("--frames {}: no sequence of {sequence} tokens fits in", config.record.frames);
        }
        let parent = |folder: &PathBuf| parent(folder, &system, network, mode.form());
        let parent = config.from.as_ref().map(parent).transpose()?;
        let actors = recorded.then(|| config.record.actors()).transpose()?;
        let arithmetic = arithmetic(config)?;
        let config = config.clone();
        Ok(Self { config, mode, system, network, learner, trainer, recording, measured, parent, actors, arithmetic })
    }

    /// Whether rollouts choose the weights. For a chain that learns single frames, rollouts say little about progress.
    pub fn rolls(&self) -> bool {
        self.config.rollouts > 0 && self.mode.frames() != Some(1)
    }

    /// Name of the truth, as on cards.
    pub fn truth(&self) -> String {
        self.measured.as_ref().map_or_else(|| self.config.record.truth(&self.system).name(), |m| m.truth.clone())
    }
}

/// Engine and precision in words. Refuses a device that this build lacks.
fn arithmetic(config: &RunConfig) -> Result<String> {
    config.device.check()?;
    Ok(match config.device {
        Device::Cpu => "f32 on the CPU".into(),
        // No mode trains on `cuda-f32`.
        Device::Cuda | Device::CudaF32 => if config.f32 { "f32 on CUDA" } else { "tf32 on CUDA" }.into(),
        Device::Flex | Device::Wgpu => format!("f32 through burn on {}", config.device),
    })
}

impl RunConfig {
    /// Path of the log, if `data` names one.
    pub fn log(&self) -> Option<PathBuf> {
        self.data.as_deref().and_then(Measured::path)
    }

    /// Loads the robot: the log's, if `data` names a log, else the one named `robot`.
    pub fn system(&self) -> Result<Arc<System>> {
        Ok(match self.log() {
            Some(log) => specified(&log)?.1,
            None => System::named(&self.robot)?,
        })
    }

    /// These settings for a log: robot and number of transitions are the log's, and nothing is recorded.
    fn of(&self, measured: &Measured) -> Self {
        let usual = RecordConfig::default();
        let record = RecordConfig { frames: self.record.frames, seed: self.record.seed, ..usual };
        Self { robot: measured.log.system.name.clone(), transitions: measured.size()[1].max(1), record, ..self.clone() }
    }

    /// The mode of these settings. Refuses needed settings that are missing, and settings that the mode does not use.
    pub fn check(&self) -> Result<Mode> {
        let log = "for recorded motion the TOML that describes it, or its folder with a log.toml, as --data";
        match &self.data {
            _ if !self.robot.is_empty() || self.log().is_some() => {}
            Some(_) => refuse!("--robot is needed, or {log}"),
            None => refuse!("--robot is needed: see `cargo xtask train --help`"),
        }
        if self.out.as_os_str().is_empty() {
            refuse!("--out is needed: see `cargo xtask train --help`");
        }
        self.mode()
    }

    /// Settings of an update, except the learning rate.
    fn learner(&self) -> LearnerConfig {
        let Self { batch, average, optimizer, huber, .. } = *self;
        LearnerConfig { batch, clip: 1.0, average, seed: self.record.seed, huber, optimizer }
    }

    /// Length of the run, learning rate and intervals.
    fn trainer(&self) -> TrainerConfig {
        let Self { updates, learning_rate, final_learning_rate, warmup, validation_windows, log_every, .. } = *self;
        TrainerConfig {
            updates,
            schedule: Schedule { start: learning_rate, end: final_learning_rate, warmup },
            validate_every: self.validate_every.unwrap_or(updates.div_ceil(50)),
            checkpoint_every: updates.div_ceil(10),
            validation_windows,
            log_every,
        }
    }
}

/// The model that a run starts from. Its truth may differ, since most of the learned dynamics carries over.
fn parent(folder: &Path, system: &System, network: TransformerConfig, form: Form) -> Result<Model> {
    let mut parent = Model::load(&shipped::find(folder), system, None)?;
    if network.positions == Positions::Rotary {
        // No weight depends on the length of training sequences.
        parent.config.network.block = network.block;
        parent.weights.config.block = network.block;
    }
    let theirs = (parent.config.form(), parent.config.network);
    if theirs.1 != network || theirs.0 != form {
        let settings = |(form, network): (Form, TransformerConfig)| json!({ "base": form.base, "view": form.view, "told": form.told, "network": network });
        let apart = between(&settings(theirs).to_string(), &settings((form, network)).to_string());
        refuse!("--from {}: its network is not as this run's: {apart}; give this run its settings", folder.display());
    }
    Ok(parent)
}
