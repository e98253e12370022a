//! One run. All that can be refused is refused before anything is recorded or written.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use nerd_model::base::Base;
use nerd_model::folder::Model;
use nerd_model::form::Form;
use nerd_model::normalizer::Normalizer;
use nerd_model::transformer::{Positions, TransformerConfig, Weights};
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::prelude::*;
use serde_json::{Value, json};

use super::card::{Identity, export, history, resume};
use super::data::{Data, Judge, Known};
use super::engine::arithmetic;
use super::{RecordConfig, RunConfig, claimed, memory};
use crate::best::Best;
#[cfg(feature = "cuda")]
use crate::device::Device;
use crate::error::{Error, Result, refuse};
use crate::learner::{Learner, LearnerConfig, LearnerState};
use crate::progress;
use crate::ranks::Ranks;
use crate::sessions;
use crate::shipped;
use crate::supply::{Supply, SupplyConfig};
use crate::trainer::{HookError, Outcome, Trainer, TrainerConfig};

/// What settings come to, ready to train.
pub struct Run {
    pub(super) config: RunConfig,
    pub(super) system: Arc<System>,
    base: Base,
    pub(super) form: Form,
    pub(super) network: TransformerConfig,
    pub(super) learner: LearnerConfig,
    trainer: TrainerConfig,
    pub(super) recording: GenerateConfig,
    /// What it starts from, if not from random weights.
    pub(super) parent: Option<Model>,
    /// Which policies act in its data; none is known of data from a folder.
    actors: Option<String>,
    arithmetic: String,
    pub(super) ranks: Arc<Ranks>,
    /// Of the runs before it.
    pub(super) known: Arc<Known>,
}

impl Run {
    /// The run of these settings.
    ///
    /// # Errors
    /// If one of them makes no sense, names what is not there, or asks for more than the machine has.
    pub fn new(config: &RunConfig) -> Result<Self> {
        config.check()?;
        let system = System::named(&config.robot)?;
        progress::notes(&system);
        let base = config.base(&system)?;
        let form = config.variant.form(base);
        let network = config.network(&system, form)?;
        let (learner, trainer) = (config.learner(), config.trainer());
        learner.check()?;
        trainer.check()?;
        // More than the run looks at would be recorded for nobody, at whatever price.
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
        if config.data.is_none() && sequence > config.record.frames {
            refuse!("--frames {}: no sequence of {sequence} tokens fits in", config.record.frames);
        }
        let parent = config.from.as_deref().map(|folder| parent(folder, &system, network, form)).transpose()?;
        let actors = config.data.is_none().then(|| config.record.actors()).transpose()?;
        let arithmetic = arithmetic(config)?;
        let (config, ranks, known) = (config.clone(), Arc::default(), Arc::default());
        Ok(Self { config, system, base, form, network, learner, trainer, recording, parent, actors, arithmetic, ranks, known })
    }

    /// The same as a run of several processes, of which this is one.
    ///
    /// # Errors
    /// If it cannot be shared out.
    pub fn among(mut self, ranks: &Arc<Ranks>) -> Result<Self> {
        let (batch, world) = (self.learner.batch, ranks.world());
        if batch < world {
            refuse!("--batch {batch}: {world} ranks need a window each");
        }
        // Before anything is recorded there.
        #[cfg(feature = "cuda")]
        if self.config.device == Device::Cuda && world > 1 {
            nerd_cuda::take(ranks.local()).map_err(|e| Error::Refused(format!("--device cuda: {e}")))?;
        }
        self.ranks = ranks.clone();
        Ok(self)
    }

    /// The same, with what the runs before it have read or recorded.
    pub(super) fn knowing(mut self, known: &Arc<Known>) -> Self {
        self.known = known.clone();
        self
    }

    /// Trains, or goes on training; the folder of the model once all updates are done, none if the minutes were over before.
    ///
    /// # Errors
    /// If the folder is another run's or in use, the truth cannot step, an update fails, or a file cannot be written.
    pub fn train(&self) -> Result<Option<PathBuf>> {
        if !self.ranks.leads() {
            return self.follow();
        }
        let made = self.lead()?;
        // The others have waited for it: the next run may begin with it.
        self.ranks.decide(made.is_some())?;
        Ok(made)
    }

    /// Trains as rank 0.
    fn lead(&self) -> Result<Option<PathBuf>> {
        let (started, out) = (Instant::now(), &self.config.out);
        let _claim = claimed(out)?;
        let mut identity = self.identity();
        resume(out, &identity)?;
        if self.config.finish && !out.join("best.safetensors").exists() {
            refuse!("{}: there is no run to finish, or it has not been validated yet", out.display());
        }
        self.agreed(&identity)?;
        let data = self.data()?;
        self.same_data(&data.sha256)?;
        (identity.transitions, identity.data_sha256) = (data.transitions, data.sha256.clone());
        let (identity, path) = (identity, out.join("run.json"));
        let first = || self.parent.as_ref().map_or_else(|| Weights::init(self.network, self.learner.seed), |p| p.weights.clone());
        let state = self.given(Some(resume(out, &identity)?.unwrap_or_else(|| LearnerState::new(first()))))?;
        let text = serde_json::to_string(&identity).map_err(Error::format(&path))?;
        let trainer = self.trainer(&text, started);
        if self.config.finish {
            let Some(best) = trainer.best()? else { refuse!("{}: no validated weights of this very run", out.display()) };
            let chosen = format!("{}; the run was ended there", self.averaged(&best));
            return self.export(&identity, data.judge.normalizer, best.weights, chosen);
        }
        let text = serde_json::to_string_pretty(&identity).map_err(Error::format(&path))?;
        nerd_sim::files::write(&path, text.as_bytes()).map_err(Error::file(&path))?;
        let (updates, windows) = (self.trainer.updates, data.windows);
        eprintln!("{} parameters, {windows} windows, update {} of {updates}", self.network.parameters(), state.step);

        let (step, fresh) = (state.step, self.supply(&data.judge.normalizer, state.step)?);
        let Data { judge, matter, .. } = data;
        let mut engine = self.engine(state, matter, &judge)?;
        let outcome = self.learn(&identity, &judge, trainer.clone(), &mut *engine, fresh, (step, started))?;
        if !outcome.finished {
            self.say_stopped(&outcome, started);
            return Ok(None);
        }
        let Some(best) = trainer.best()? else {
            refuse!("{}: in no validation did the rollouts end in numbers; give it more --updates", out.display());
        };
        let (weights, chosen) = self.choose(&identity, &judge, best, &mut *engine)?;
        self.export(&identity, judge.normalizer, weights, chosen)
    }

    /// What makes its updates until the minutes are over; `run` is kept in its checkpoints.
    pub(super) fn trainer(&self, run: &str, started: Instant) -> Trainer {
        let trainer = Trainer::new(self.trainer, self.learner.batch, &self.config.out, run);
        trainer.stop_at(self.left(started)).among(&self.ranks)
    }

    /// What is left of its minutes, a second at least.
    fn left(&self, started: Instant) -> Option<Duration> {
        // More minutes than a duration holds are no limit.
        let left = |minutes: f64| Duration::try_from_secs_f64((60.0 * minutes - started.elapsed().as_secs_f64()).max(1.0)).ok();
        self.config.minutes.and_then(left)
    }

    /// What decides the run's bytes, as far as it is known before its data is.
    pub(super) fn identity(&self) -> Identity {
        let RecordConfig { frames, torque_scale, hold, resets, .. } = self.config.record;
        let truth = self.config.record.truth(&self.system);
        Identity {
            robot: self.system.name.clone(),
            robot_sha256: self.system.robot_sha256(),
            system_sha256: self.system.sha256(),
            truth: truth.name(),
            base: self.base,
            variant: self.config.variant,
            network: self.network,
            unrolled: self.config.unrolled(),
            learner: self.learner,
            trainer: self.trainer,
            epsilon: self.config.epsilon,
            arithmetic: self.arithmetic.clone(),
            rollouts: self.config.rollouts,
            frames,
            torque_scale,
            hold,
            resets,
            policies: self.recording.pilot.as_ref().map(|p| format!("{p:?}")),
            data_sha256: String::new(),
            transitions: self.config.transitions,
            fresh: self.config.fresh,
            from: self.parent.as_ref().map(|p| history(&p.config)),
            from_sha256: self.parent.as_ref().map(|p| p.config.model_sha256.clone()),
        }
    }

    /// Fresh data from update `step` on, if it is asked for.
    pub(super) fn supply(&self, normalizer: &Normalizer, step: u64) -> Result<Option<Supply>> {
        if self.config.fresh == 0 {
            return Ok(None);
        }
        let (truth, of, data) = (self.config.record.truth(&self.system), self.system.clone(), self.recording.clone());
        let shards = self.config.fresh.div_ceil(data.frames * data.shard_trajectories) as u64;
        let (updates, history, form, normalizer) = (self.trainer.updates, self.network.sequence(), self.form, normalizer.clone());
        let config = SupplyConfig { data, shards, updates, step, history, form, normalizer };
        Ok(Some(Supply::among(&self.ranks, &self.system, move || truth.solver(&of), config)?))
    }

    /// All updates, or as many as there is time for; each validation ends a line of `sessions.jsonl`.
    fn learn(
        &self,
        identity: &Identity,
        judge: &Judge,
        trainer: Trainer,
        engine: &mut dyn Learner,
        fresh: Option<Supply>,
        (first, started): (u64, Instant),
    ) -> Result<Outcome> {
        let mut logged = (first, Duration::ZERO);
        let mut log = |step: u64| -> Result<()> {
            let (now, world) = (started.elapsed(), self.ranks.world());
            let spent = if world > 1 { format!("{world} ranks") } else { String::new() };
            sessions::log(&self.config.out, logged.0, step, (now - logged.1).as_secs_f64(), &spent)?;
            logged = (step, now);
            Ok(())
        };
        let mut hook = |learner: &mut dyn Learner, step: u64| -> Result<Option<f64>, HookError> {
            let error = if self.config.rolls() {
                let weights = Weights { config: self.network, flat: learner.state()?.average };
                // Early weights may leave; that is an infinite error, not the end of the run.
                Some(self.rollout_error(identity, judge, weights).unwrap_or_else(|e| {
                    eprintln!("{e}");
                    f64::INFINITY
                }))
            } else {
                None
            };
            log(step)?;
            Ok(error)
        };
        // Time that was spent until here is spent.
        let outcome = trainer.stop_at(self.left(started)).run(engine, fresh, &mut hook)?;
        log(outcome.step)?;
        Ok(outcome)
    }

    fn say_stopped(&self, outcome: &Outcome, started: Instant) {
        let (TrainerConfig { updates, validate_every, .. }, seconds) = (self.trainer, started.elapsed().as_secs());
        let so_far = match outcome.best {
            Some((step, _)) => format!("with --finish it makes a model of the best weights so far, those of update {step}"),
            None => format!("there is no model yet: the first validation is at update {}", validate_every.max(1).min(updates)),
        };
        eprintln!("stopped at update {} of {updates} after {seconds} s; the same command continues; {so_far}", outcome.step);
    }

    fn averaged(&self, best: &Best) -> String {
        format!("moving average {} at update {}, chosen by criterion {:.5}", self.learner.average, best.step, best.criterion)
    }

    /// The best average, or the last weights: where the rate has fallen to zero they need none, and may be better than it.
    fn choose(&self, identity: &Identity, judge: &Judge, best: Best, engine: &mut dyn Learner) -> Result<(Weights, String)> {
        if self.config.rolls() {
            let last = engine.state()?.weights;
            let found = self.rollout_error(identity, judge, last.clone()).unwrap_or(f64::INFINITY);
            if found < best.criterion {
                let updates = self.trainer.updates;
                return Ok((last, format!("last, not averaged, at update {updates}, chosen by criterion {found:.5}")));
            }
        }
        let chosen = self.averaged(&best);
        Ok((best.weights, chosen))
    }

    fn export(&self, identity: &Identity, normalizer: Normalizer, weights: Weights, chosen: String) -> Result<Option<PathBuf>> {
        let out = &self.config.out;
        let folder = out.join("model");
        export(&folder, out, identity, normalizer, weights, (chosen, self.actors.clone(), self.learner.seed))?;
        eprintln!("model written to {}", folder.display());
        Ok(Some(folder))
    }
}

/// The model that a run starts from. It may have learned another truth: most of what it knows holds in this one, too.
fn parent(folder: &Path, system: &System, network: TransformerConfig, form: Form) -> Result<Model> {
    let mut parent = Model::load(&shipped::find(folder), system, None)?;
    let like = |form: Form| (form.view, form.base.flies(), form.base.moves());
    if network.positions == Positions::Rotary {
        // No weight depends on how long its training sequences were.
        parent.config.network.block = network.block;
        parent.weights.config.block = network.block;
    }
    if parent.config.network != network || like(parent.config.form()) != like(form) {
        let apart = apart((parent.config.form(), &parent.config.network), (form, &network));
        refuse!("--from {}: its network is not as this run's: {apart}; give this run its settings", folder.display());
    }
    Ok(parent)
}

/// In which settings two networks differ, the second being this run's.
fn apart(theirs: (Form, &TransformerConfig), ours: (Form, &TransformerConfig)) -> String {
    let settings = |(form, network): (Form, &TransformerConfig)| {
        let mut all = json!({ "base": form.base, "view": form.view });
        if let (Some(all), Value::Object(network)) = (all.as_object_mut(), json!(network)) {
            all.extend(network);
        }
        all
    };
    let (theirs, ours) = (settings(theirs), settings(ours));
    let word = |value: &Value| value.to_string().replace(['"', '{', '}'], "").replace(':', " ");
    let keys = theirs.as_object().into_iter().flatten().filter(|(key, value)| ours[*key] != **value);
    keys.map(|(key, value)| format!("{key} is {}, here {}", word(value), word(&ours[key]))).collect::<Vec<_>>().join(", ")
}
