//! Trains one run: gets its data, makes its updates and exports its model.

use super::card::{export, resume};
use super::criterion::rollout_error;
use super::data::{Cache, Data, Judge};
use super::engine::engine;
use super::*;
use crate::checkpoint::{self, Best};
use crate::files;
use crate::records::{Session, ours};
use crate::supply::{Supply, SupplyConfig};
use crate::trainer::{Outcome, Trainer};

/// A checked run, ready to train.
pub struct Run {
    plan: Plan,
    /// Motions that earlier runs of a recipe read or recorded.
    pub(super) cache: Arc<Cache>,
}

impl Run {
    /// Checks the settings and plans the run.
    pub fn new(config: &RunConfig) -> Result<Self> {
        Ok(Self { plan: Plan::new(config)?, cache: Arc::default() })
    }

    /// Trains, or resumes training. Returns the folder of the model after the last update; `None` if time ran out
    /// before.
    pub fn train(&self) -> Result<Option<PathBuf>> {
        let Self { plan, cache } = self;
        let started = Instant::now();
        let config = &plan.config;
        let out = &plan.config.out;
        ours(out)?;
        let _claim = claimed(out)?;
        let mut identity = Identity::of(plan);
        resume(out, &identity)?;
        if config.finish && !checkpoint::best(out).exists() {
            refuse!("{}: there is no run to finish, or it has not been validated yet", out.display());
        }
        let data = Data::of(plan, cache)?;
        (identity.transitions, identity.data_sha256) = (data.transitions, data.sha256.clone());
        let first = || {
            plan.parent.as_ref().map_or_else(|| Weights::init(plan.network, plan.learner.seed), |p| p.weights.clone())
        };
        let state = resume(out, &identity)?.unwrap_or_else(|| LearnerState::new(first()));
        let made = if config.finish {
            Some(self.finish(&identity, data.judge)?)
        } else {
            self.updates(&identity, data, state, started)?
        };
        Ok(made.map(|()| out.join("model")))
    }

    /// Exports the best weights so far as a model.
    fn finish(&self, identity: &Identity, judge: Judge) -> Result<()> {
        let best = self.trainer(identity)?.best()?;
        let Some(best) = best else {
            refuse!("{}: no validated weights of this very run", self.plan.config.out.display())
        };
        let chosen = format!("{}; the run was ended there", self.averaged(&best));
        export(&self.plan, identity, judge.normalizer, best.weights, chosen)
    }

    /// Makes the remaining updates, and the model if time was enough. Each validation writes a line of
    /// `sessions.jsonl`.
    fn updates(&self, identity: &Identity, data: Data, state: LearnerState, started: Instant) -> Result<Option<()>> {
        let plan = &self.plan;
        let out = &self.plan.config.out;
        let Data { judge, sets, windows, .. } = data;
        let step = state.step;
        let mut trainer = self.trainer(identity)?;
        let fresh = self.supply(&judge.normalizer, step)?;
        // The learner is made before files are written, so that a device that refuses the run leaves none behind.
        let mut engine = engine(plan, state, sets)?;
        // The time to prepare the data counts as time of the run.
        trainer.stop_at = self.left(started);
        let path = out.join("run.json");
        let text = serde_json::to_string_pretty(identity).map_err(Error::file(&path))?;
        files::write(&path, text)?;
        tell!("{} parameters, {windows} windows, update {step} of {}", plan.network.parameters(), plan.trainer.updates);
        let mut logged = (step, Duration::ZERO);
        let mut log = |step: u64| -> Result<()> {
            let now = started.elapsed();
            Session::log(out, logged.0, step, (now - logged.1).as_secs_f64(), "")?;
            logged = (step, now);
            Ok(())
        };
        let mut hook = |learner: &mut dyn Learner, step: u64| -> Result<Option<f64>> {
            // Rollouts of early weights may fail. Their error is then infinite, and the run goes on.
            let lost = |e: Error| {
                tell!("{e}");
                f64::INFINITY
            };
            let weights = if plan.rolls() { Some(learner.state()?.averaged()) } else { None };
            let error = weights.map(|weights| rollout_error(plan, identity, &judge, weights).unwrap_or_else(lost));
            log(step)?;
            Ok(error)
        };
        let outcome = trainer.run(&mut *engine, fresh, &mut hook)?;
        log(outcome.step)?;
        if !outcome.finished {
            self.say_stopped(&outcome, started);
            return Ok(None);
        }
        let Some(best) = trainer.best()? else {
            refuse!("{}: in no validation did the rollouts end in numbers; give it more --updates", out.display());
        };
        let (weights, chosen) = self.choose(identity, &judge, best, &mut *engine)?;
        export(plan, identity, judge.normalizer, weights, chosen).map(Some)
    }

    fn trainer(&self, identity: &Identity) -> Result<Trainer> {
        let run = serde_json::to_string(identity).map_err(Error::file(&self.plan.config.out))?;
        Ok(Trainer::new(self.plan.trainer, self.plan.learner.batch, &self.plan.config.out, &run))
    }

    /// Remaining time of the run, at least a second; `None` without a limit.
    fn left(&self, started: Instant) -> Option<Duration> {
        // Minutes beyond the range of a duration are no limit.
        let left = |minutes: f64| {
            Duration::try_from_secs_f64((60.0 * minutes - started.elapsed().as_secs_f64()).max(1.0)).ok()
        };
        self.plan.config.minutes.and_then(left)
    }

    /// The supply of fresh data from update `step` on, if the run has any.
    fn supply(&self, normalizer: &Normalizer, step: u64) -> Result<Option<Supply>> {
        let plan = &self.plan;
        let fresh = plan.config.fresh_transitions;
        let data = GenerateConfig { until: None, ..plan.recording.clone() };
        if fresh == 0 {
            return Ok(None);
        }
        let truth = plan.config.record.truth(&plan.system);
        let system = plan.system.clone();
        let shards = fresh.div_ceil(data.frames * data.shard_trajectories) as u64;
        let updates = plan.trainer.updates;
        let history = plan.network.sequence();
        let form = plan.mode.form();
        let normalizer = normalizer.clone();
        let config = SupplyConfig { data, shards, updates, step, history, form, normalizer };
        Ok(Some(Supply::new(&plan.system, move || truth.solver(&system), config)?))
    }

    fn say_stopped(&self, outcome: &Outcome, started: Instant) {
        let TrainerConfig { updates, validate_every, .. } = self.plan.trainer;
        let seconds = started.elapsed().as_secs();
        let so_far = match outcome.best {
            Some((step, _)) => {
                format!("with --finish it makes a model of the best weights so far, those of update {step}")
            }
            None => format!(
                "there is no model yet: the first validation is at update {}",
                validate_every.max(1).min(updates)
            ),
        };
        tell!(
            "stopped at update {} of {updates} after {seconds} s; the same command continues; {so_far}",
            outcome.step
        );
    }

    fn averaged(&self, best: &Best) -> String {
        format!(
            "moving average {} at update {}, chosen by criterion {:.5}",
            self.plan.learner.average, best.step, best.criterion
        )
    }

    /// Chooses the best averaged weights or the last weights, by criterion. After a decay of the learning rate to zero,
    /// the last weights need no average and may be better.
    fn choose(
        &self,
        identity: &Identity,
        judge: &Judge,
        best: Best,
        engine: &mut dyn Learner,
    ) -> Result<(Weights, String)> {
        if self.plan.rolls() {
            let last = engine.state()?.weights;
            let found = rollout_error(&self.plan, identity, judge, last.clone()).unwrap_or(f64::INFINITY);
            if found < best.criterion {
                let updates = self.plan.trainer.updates;
                return Ok((last, format!("last, not averaged, at update {updates}, chosen by criterion {found:.5}")));
            }
        }
        let chosen = self.averaged(&best);
        Ok((best.weights, chosen))
    }
}
