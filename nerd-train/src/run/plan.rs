//! The plan from settings: base, network, learner, trainer, data to record. Everything that can be refused is refused here, before
//! anything is recorded or written.

use nerd_model::chain::{self, Chain};
use nerd_sim::{dataset::Manifest, log::specified, vary};

use super::*;
use crate::progress;
use crate::schedule::Schedule;
use crate::stop::PATIENCE;

/// Fewest tokens of a training sequence, if not said: short ones have few tokens with a whole past.
const SEQUENCE: usize = 32;

pub(super) struct Plan {
    pub config: RunConfig,
    pub system: Arc<System>,
    pub form: Form,
    pub network: TransformerConfig,
    pub learner: LearnerConfig,
    pub trainer: TrainerConfig,
    pub recording: GenerateConfig,
    /// The log that it learns from, if that is its data.
    pub measured: Option<Measured>,
    /// What it starts from, if not from random weights.
    pub parent: Option<Model>,
    /// Which policies act in its data; none is known of data from a folder.
    pub actors: Option<String>,
    /// Engine and precision, in words.
    pub arithmetic: String,
}

impl Plan {
    pub fn new(config: &RunConfig) -> Result<Self> {
        config.check()?;
        let measured = config.log().map(|log| Measured::read(&log, config.held_out.as_deref().unwrap_or_default())).transpose()?;
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
        let form = Form { base: config.base, view: config.view, told: config.told };
        let network = config.network(&system, form)?;
        if config.told && vary::columns(&system).is_empty() {
            refuse!("--told: nothing of `{}` is drawn; give its TOML a [vary]", system.name);
        }
        if config.unrolled().is_some() && config.log().is_none() && system.noisy() {
            refuse!(
                "--sequence rolls out from states as they are, and sensors of `{}` have noise: take --history or --stream",
                system.name
            );
        }
        let (learner, trainer) = (config.learner(), config.trainer());
        learner.check().and(trainer.check()).map_err(Error::Refused)?;
        // More than the run reads would be wasted.
        let (fresh, batch, sequence) = (config.fresh, learner.batch, network.sequence());
        let looked_at = u128::from(trainer.updates) * (batch * sequence) as u128;
        if fresh as u128 > looked_at {
            refuse!("--fresh {fresh}: {} updates of {batch} sequences of {sequence} look at {looked_at} tokens", trainer.updates);
        }
        memory::check(config, &network)?;
        let mut recording = config.record.of(&system, config.transitions)?;
        // Small shards come soon, whatever the truth.
        recording.shard_trajectories = if fresh > 0 { 64 } else { 512 };
        if fresh > 0 {
            recording.transitions = recording.transitions.next_multiple_of(recording.frames * recording.shard_trajectories);
        }
        recording.check(&system)?;
        recording.until = Stop::after(Instant::now() + PATIENCE, config.minutes).0;
        let sequence = config.unrolled().unwrap_or(1).max(sequence);
        if config.data.is_none() && sequence > config.record.frames {
            refuse!("--frames {}: no sequence of {sequence} tokens fits in", config.record.frames);
        }
        let parent = config.from.as_deref().map(|folder| parent(folder, &system, network, form)).transpose()?;
        let actors = config.data.is_none().then(|| config.record.actors()).transpose()?;
        let arithmetic = arithmetic(config)?;
        let config = config.clone();
        Ok(Self { config, system, form, network, learner, trainer, recording, measured, parent, actors, arithmetic })
    }

    /// What it learns, as cards have it.
    pub fn truth(&self) -> String {
        self.measured.as_ref().map_or_else(|| self.config.record.truth(&self.system).name(), |m| m.truth.clone())
    }

    /// The chain that its network moves along.
    pub fn chain(&self) -> Result<Chain> {
        Chain::of(&self.system).map_err(|e| Error::Refused(e.to_string()))
    }
}

/// What computes a run and how exactly; refused where this program has no such engine.
fn arithmetic(config: &RunConfig) -> Result<String> {
    config.device.check()?;
    Ok(match config.device {
        Device::Cpu => "f32 on the CPU".into(),
        // `check` refuses the second.
        Device::Cuda | Device::CudaF32 => if config.f32 { "f32 on CUDA" } else { "tf32 on CUDA" }.into(),
        Device::Flex | Device::Wgpu => format!("f32 through burn on {}", config.device),
    })
}

impl RunConfig {
    /// The log that is its data, if one is.
    pub fn log(&self) -> Option<PathBuf> {
        self.data.as_deref().and_then(Measured::path)
    }

    /// Its robot.
    pub fn system(&self) -> Result<Arc<System>> {
        Ok(match self.log() {
            Some(log) => specified(&log)?.1,
            None => System::named(&self.robot)?,
        })
    }

    /// The same for a log, which nothing is recorded beside.
    fn of(&self, measured: &Measured) -> Self {
        let usual = RecordConfig::default();
        let record = RecordConfig { frames: self.record.frames, seed: self.record.seed, ..usual };
        Self { robot: measured.log.system.name.clone(), transitions: measured.size()[1].max(1), record, ..self.clone() }
    }

    /// Refuses settings that mean nothing together.
    pub fn check(&self) -> Result<()> {
        let (chain, recorded) = (self.variant == Variant::Chain, self.data.is_none());
        let log = self.log().is_some();
        let rolled = !chain && self.unrolled().is_some();
        let (residual, usual) = (self.variant.usual() && self.history == 1 && !self.stream, Self::default());
        let wrong = [
            (
                self.robot.is_empty() && !log && !recorded,
                "--robot is needed, or for recorded motion the TOML that describes it, or its folder with a log.toml, as --data",
            ),
            (self.robot.is_empty() && !log, "--robot is needed: see `cargo xtask train --help`"),
            (!self.robot.is_empty() && log, "--robot: the log of --data names it; leave it out"),
            (self.record.truth.is_some() && log, "--truth: recorded motion is the truth; leave it out"),
            (chain && log, "--variant chain means nothing with recorded motion of --data"),
            (self.held_out.is_some() && !log, "--held-out means nothing without a log as --data"),
            (self.out.as_os_str().is_empty(), "--out is needed: see `cargo xtask train --help`"),
            (!recorded && self.fresh > 0, "--fresh records by itself: leave out --data"),
            (!recorded && !self.record.policy.is_empty(), "--policy records by itself: leave out --data"),
            (chain && self.stream, "--stream means nothing with --variant chain"),
            (chain && self.base != Base::State, "--base means nothing with --variant chain"),
            (chain && self.view != View::Own, "--view means nothing with --variant chain"),
            (chain && self.told, "--told means nothing with --variant chain"),
            (self.told && rolled, "--told means nothing where --sequence rolls out"),
            (self.told && log, "--told means nothing with recorded motion of --data: nothing was drawn"),
            (chain && self.fresh > 0, "--fresh means nothing with --variant chain"),
            (chain && self.epsilon.is_some(), "--epsilon means nothing with --variant chain"),
            (chain && self.huber.is_some(), "--huber means nothing with --variant chain"),
            (
                self.sequence.is_some_and(|frames| frames > 1) && !self.stream && !chain && !rolled,
                "--sequence means nothing without --stream, --variant chain or NeRD with --history 1",
            ),
            (
                rolled && self.from.is_none(),
                "--sequence with --history 1 goes on from a model that knows single frames: give it with --from",
            ),
            (chain && !matches!(self.device, Device::Cpu | Device::Cuda), "--device: chains are trained on cpu and cuda, no other"),
            (rolled && self.device != Device::Cpu, "--device: where --sequence rolls out, cpu alone trains"),
            (rolled && self.huber.is_some(), "--huber means nothing where --sequence rolls out"),
            (rolled && self.fresh > 0, "--fresh means nothing where --sequence rolls out"),
            (self.epsilon.is_some() && self.from.is_some(), "--epsilon: the model that --from starts from has its own; leave one out"),
            (self.device == Device::CudaF32, "--device cuda-f32 is for models that are used; train with --device cuda --f32"),
            (self.f32 && self.device != Device::Cuda, "--f32 means nothing without --device cuda"),
            (residual && self.head_width != usual.head_width, "--head-width means nothing with --history 1, which has no attention"),
        ];
        match wrong.iter().find(|(wrong, _)| *wrong) {
            Some((_, why)) => refuse!("{why}"),
            None => Ok(()),
        }
    }

    /// Shape of its network.
    pub fn network(&self, system: &System, form: Form) -> Result<TransformerConfig> {
        let Self { embedding, layers, history, .. } = *self;
        let wrong = |reason: String| Error::Refused(format!("--embedding {embedding}, --layers {layers}: {reason}"));
        let mut network = if self.variant == Variant::Chain {
            let block = Chain::of(system).map_err(|e| Error::Refused(e.to_string()))?.rods;
            let paper = TransformerConfig::paper(chain::INPUTS, chain::OUTPUTS, embedding);
            TransformerConfig { layers, heads: 1, block, history: 1, head: 1, architecture: Architecture::Chain, ..paper }
        } else {
            let paper = TransformerConfig::paper(Features::inputs(system, form), Features::outputs(system), embedding);
            let heads = (embedding / self.head_width.max(1)).max(1);
            match history {
                1 if !self.stream => {
                    TransformerConfig { layers, heads: 1, history, block: 1, head: 1, architecture: Architecture::Residual, ..paper }
                }
                _ => TransformerConfig { layers, heads, history, block: paper.block.max(history), ..paper },
            }
        };
        if self.stream {
            network.positions = Positions::Rotary;
            // All that a rollout's prediction will depend on, so that none has a longer past than training ever showed.
            network.block = self.sequence.unwrap_or(network.reach().max(SEQUENCE)).max(history);
        }
        network.check().map_err(wrong)?;
        Ok(network)
    }

    /// Frames of a rollout in training, where it goes through them: of a chain always, of a robot seen by one token from two on.
    pub fn unrolled(&self) -> Option<usize> {
        match self.sequence.unwrap_or(1) {
            frames if self.variant == Variant::Chain => Some(frames),
            frames => (self.variant.usual() && self.history == 1 && !self.stream && frames > 1).then_some(frames),
        }
    }

    /// Whether rollouts choose its weights: where a chain learns single frames, rollouts say little of its progress.
    pub(super) fn rolls(&self) -> bool {
        self.rollouts > 0 && self.unrolled() != Some(1)
    }

    /// What an update needs beside the learning rate.
    pub fn learner(&self) -> LearnerConfig {
        let Self { batch, average, huber, optimizer, .. } = *self;
        LearnerConfig { batch, clip: 1.0, average, seed: self.record.seed, huber, optimizer }
    }

    /// Length of the run, its learning rate, and how often it does what.
    pub fn trainer(&self) -> TrainerConfig {
        let Self { updates, rate, last_rate, warmup, validation_windows, log_every, .. } = *self;
        TrainerConfig {
            updates,
            schedule: Schedule { start: rate, end: last_rate, warmup },
            validate_every: self.validate_every.unwrap_or(updates.div_ceil(50)),
            checkpoint_every: updates.div_ceil(10),
            validation_windows,
            log_every,
        }
    }
}

/// The model that a run starts from. It may have learned another truth, since most of that carries over.
fn parent(folder: &Path, system: &System, network: TransformerConfig, form: Form) -> Result<Model> {
    let mut parent = Model::load(&shipped::find(folder), system, None)?;
    if network.positions == Positions::Rotary {
        // No weight depends on how long its training sequences were.
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
