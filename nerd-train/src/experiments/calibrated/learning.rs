//! One calibrated robot and the parts of its log: how each way of learning goes.

use nerd_core::dynamics::Data;
use nerd_model::base::Base;
use nerd_model::folder::Model;
use nerd_sim::articulated::Draft;
use nerd_sim::calibrate::{Distance, Engine, Parameter, Subject, Trial, mean, objective};
use nerd_sim::dataset::Recording;
use nerd_sim::log::Log;
use nerd_sim::sampling::stream;
use rand::RngExt;

use super::learn::Effort;
use super::split::{Parts, Scored};
use crate::error::{Result, refuse};
use crate::progress::bar;
use crate::unroll::{SmallModel, Unroll, UnrollConfig, distances, single};

/// Scale of what a network on a calibrated solver says: most of what that is off by in a frame is noise.
const NEAR: f64 = 0.1;
/// Simulations that differ behind a pretraining, and by how much of their bounds parameters differ in them.
const WORLDS: usize = 24;
const SPREAD: f64 = 0.03;
/// Rates at which a network that knows something is tuned, one after the other, each from the best weights so far.
const TUNED: [f64; 3] = [3e-4, 1e-4, 3e-5];
/// Ways of learning with updates over many frames.
const MANY: [&str; 3] = ["residual", "fine-tuned", "real-only"];
/// Ways of learning that begin in simulation.
const SIMULATED: [&str; 3] = ["pretrained", "paper", "fine-tuned"];

/// A calibrated robot, the parts of its log, and what is learned from them.
pub struct Learning<'a> {
    pub log: &'a Log,
    pub subject: &'a Subject,
    pub parameters: &'a [Parameter],
    pub values: &'a [f64],
    pub parts: &'a Parts,
    pub effort: Effort,
}

impl Learning<'_> {
    /// Refuses what would fail only after everything was fitted.
    ///
    /// # Errors
    /// One line.
    pub fn check(&self, ways: &[String]) -> Result<()> {
        let Effort { sequence, history, .. } = self.effort;
        if self.parts.validation.is_empty() {
            refuse!("--learn: no rollout is left to choose the best weights by; take a smaller --train, or more trajectories");
        }
        if self.log_trials(sequence + 1).is_empty() {
            refuse!("--sequence {sequence}: no trajectory that is trained on has as many frames; take a smaller one");
        }
        if let Some(way) = ways.iter().find(|way| history > 1 && MANY.contains(&way.as_str())) {
            refuse!("--history {history}: {way} trains over many frames, which only a network that sees one can");
        }
        if history > sequence {
            refuse!(
                "--history {history} is more than the {sequence} frames of a rollout in training; take a smaller one, or a larger --sequence"
            );
        }
        if ways.iter().any(|way| way.starts_with("residual")) && !(1..=Draft::MOST).contains(&self.substeps()) {
            refuse!("--learn residual stands on at most {} substeps, --substeps says {}", Draft::MOST, self.substeps());
        }
        let Effort { embedding, layers, .. } = self.effort;
        match self.silent(Base::ExactFlight) {
            Ok(_) => Ok(()),
            Err(error) => refuse!("--embedding {embedding} --layers {layers}: {error}"),
        }
    }

    /// Models by way, in the order asked for.
    ///
    /// # Errors
    /// What training says.
    pub fn learn(&self, ways: &[String]) -> Result<Vec<Model>> {
        let pretrained = ways.iter().any(|way| SIMULATED.contains(&way.as_str())).then(|| self.pretrained()).transpose()?;
        let first = || pretrained.clone().map_or_else(|| refuse!("nothing was learned in simulation"), Ok);
        let (solver, contact) = (Base::Draft(self.substeps()), Base::ExactFlight);
        let tuned =
            |model: Model, train: &dyn Fn(&Model, f64) -> Result<Model>| TUNED.iter().try_fold(model, |model, rate| train(&model, *rate));
        let learn = |way: &String| match way.as_str() {
            "residual" => self.many(&self.silent(solver)?, 2e-3),
            "residual-single" => self.singles(&self.silent(solver)?, 1e-3),
            "pretrained" => first(),
            "paper" => tuned(first()?, &|model, rate| self.singles(model, rate)),
            "fine-tuned" => tuned(first()?, &|model, rate| self.many(model, rate)),
            // Which word it is was looked at before.
            _ => tuned(self.singles(&self.silent(contact)?, 3e-3)?, &|model, rate| self.many(model, rate)),
        };
        ways.iter().map(learn).collect()
    }

    /// Substeps of the calibrated solver, which are those of the draft that learning stands on.
    fn substeps(&self) -> usize {
        match self.subject.engine {
            Engine::Articulated(config) => config.contact_substeps,
            Engine::Rapier(_) => 0,
        }
    }

    fn real(&self) -> Result<Recording> {
        let mut log = self.log.clone();
        log.trajectories.retain(|t| self.parts.trained.contains(&t.id));
        log.system = self.subject.system.clone();
        Ok(log.recording(self.effort.sequence)?)
    }

    fn silent(&self, base: Base) -> Result<Model> {
        let scale = if matches!(base, Base::Draft(_)) { NEAR } else { 1.0 };
        self.small(base, scale).silent(self.subject, "measured", &self.real()?, self.effort.seed)
    }

    fn small(&self, base: Base, scale: f64) -> SmallModel {
        let Effort { embedding, layers, sequence, history, .. } = self.effort;
        SmallModel { base, embedding, layers, history, sequence, scale }
    }

    /// Training over many frames, the best weights by the validation part.
    fn many(&self, model: &Model, rate: f64) -> Result<Model> {
        let (unit, train) = (self.unit()?, self.log_trials(self.effort.sequence + 1));
        let unroll = Unroll { subject: self.subject, train: &train, validation: &self.parts.validation, unit };
        let Effort { updates, seed, .. } = self.effort;
        let bar = bar("updates over many frames", updates);
        let config = UnrollConfig { updates, rate, seed, validate_every: (updates / 16).max(1), ..Default::default() };
        let found = unroll.train(model, config, &mut |done, error, best| {
            bar.say(&format!("error {error:.3}, validation {best:.4}"));
            bar.set(done);
        })?;
        bar.finish();
        Ok(found.0)
    }

    fn log_trials(&self, length: usize) -> Vec<Trial> {
        self.log.trials(length, 3).into_iter().filter(|t| self.parts.trained.contains(&t.id)).collect()
    }

    /// Training on single measured frames.
    fn singles(&self, model: &Model, rate: f64) -> Result<Model> {
        self.on_frames(model, &self.real()?, rate, &self.parts.validation, "updates on single frames")
    }

    fn on_frames(&self, model: &Model, recording: &Recording, rate: f64, validation: &[Trial], what: &str) -> Result<Model> {
        let unit = self.unit()?;
        let worth = |model: &Model| Ok(objective(&mean(&distances(model, self.subject, validation)?), &unit));
        let Effort { singles, seed, device, .. } = self.effort;
        let bar = bar(what, singles);
        let config = UnrollConfig { updates: singles, batch: 32, rate, seed, validate_every: (singles / 16).max(1) };
        let found = single(model, self.subject, recording, (config, device), &worth, &mut |done, best| {
            bar.say(&format!("validation {best:.4}"));
            bar.set(done);
        })?;
        bar.finish();
        Ok(found.0)
    }

    /// A NeRD of the calibrated solver: contact learned from simulations whose parameters differ, from measured starts.
    fn pretrained(&self) -> Result<Model> {
        let mut rng = stream(self.effort.seed, 2);
        let (system, mut data) = (&self.subject.system, Data::new(&self.subject.system.robot));
        let mut recording = Recording::empty(self.effort.sequence);
        let whole: Vec<Trial> = self.log_trials(0);
        for _ in 0..WORLDS {
            let value = |(p, v): (&Parameter, &f64)| p.at(p.place(*v) + SPREAD * (2.0 * rng.random::<f64>() - 1.0));
            let values: Vec<f64> = self.parameters.iter().zip(self.values).map(value).collect();
            let world = self.subject.with(self.parameters, &values)?;
            let motions = world.states_in(&whole, &|| world.engine.solver())?;
            for (motion, trial) in motions.iter().zip(&whole) {
                // Where a solver gives up, the state stands still though its velocity does not.
                let moves = |pair: &[Vec<f64>]| pair[0] != pair[1] || pair[0][system.robot.nq()..].iter().all(|v| v.abs() < 1e-3);
                let sound = motion.windows(2).take_while(|pair| moves(pair)).count();
                recording.cut(system, &self.subject.scene, &motion[..sound + 1], &trial.torques[..sound], &mut data);
            }
        }
        let model = self.small(Base::ExactFlight, 1.0).silent(self.subject, "calibrated", &recording, self.effort.seed)?;
        self.on_frames(&model, &recording, 3e-3, &self.simulated()?, "updates on simulated frames")
    }

    /// The validation part as the calibrated solver moves.
    fn simulated(&self) -> Result<Vec<Trial>> {
        let motions = self.subject.roll(&self.parts.validation)?;
        Ok(self.parts.validation.iter().zip(motions).map(|(t, measured)| Trial { measured, ..t.clone() }).collect())
    }

    /// Units of errors: those of the calibrated solver.
    fn unit(&self) -> Result<Distance> {
        Ok(mean(&self.subject.distances(&self.parts.validation)?))
    }

    /// A model's errors on what nothing was fitted to; whole trajectories; and how far it is from the calibrated solver.
    ///
    /// # Errors
    /// What the solver says.
    pub fn judged(&self, model: &Model, seed: u64) -> Result<(Scored, Scored, Distance)> {
        let of = |trials: &[Trial]| -> Result<Scored> { Ok(Scored::new(trials, &distances(model, self.subject, trials)?, seed)) };
        let simulated = mean(&distances(model, self.subject, &self.simulated()?)?);
        Ok((of(&self.parts.judged)?, of(&self.parts.whole)?, simulated))
    }
}
