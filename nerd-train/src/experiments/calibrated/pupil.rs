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
use crate::unroll::{Shape, Unroll, UnrollConfig, distances, single};

/// Scale of what a network on a calibrated solver says: most of what that is off by in a frame is noise.
const NEAR: f64 = 0.1;
/// Simulations that differ behind a pretraining, and by how much of their bounds parameters differ in them.
const WORLDS: usize = 24;
const SPREAD: f64 = 0.03;

/// A calibrated robot, the parts of its log, and what is learned from them.
pub struct Pupil<'a> {
    pub log: &'a Log,
    pub subject: &'a Subject,
    pub parameters: &'a [Parameter],
    pub values: &'a [f64],
    pub parts: &'a Parts,
    pub effort: Effort,
}

impl Pupil<'_> {
    /// Models by way, in the order asked for.
    ///
    /// # Errors
    /// What training says.
    pub fn learn(&self, ways: &[String]) -> Result<Vec<Model>> {
        let simulated = ["pretrained", "paper", "fine-tuned"];
        let pretrained = ways.iter().any(|way| simulated.contains(&way.as_str())).then(|| self.pretrained()).transpose()?;
        let first = || pretrained.clone().map_or_else(|| refuse!("nothing was learned in simulation"), Ok);
        let (solver, contact) = (Base::Draft(self.substeps()), Base::ExactFlight);
        let learn = |way: &String| match way.as_str() {
            "residual" => self.many(&self.silent(solver)?, 2e-3),
            "residual-single" => self.singles(&self.silent(solver)?, 1e-3),
            "pretrained" => first(),
            "paper" => self.singles(&first()?, 1e-4),
            "fine-tuned" => self.many(&first()?, 3e-4),
            // Which word it is was looked at before.
            _ => self.many(&self.singles(&self.silent(contact)?, 3e-3)?, 3e-4),
        };
        ways.iter().map(learn).collect()
    }

    /// Substeps of the calibrated solver that a draft may have.
    fn substeps(&self) -> usize {
        match self.subject.engine {
            Engine::Articulated(config) => config.contact_substeps.clamp(1, Draft::MOST),
            _ => 4,
        }
    }

    fn real(&self) -> Result<Recording> {
        let mut log = self.log.clone();
        log.trajectories.retain(|t| self.parts.trained.contains(&t.id));
        log.system = self.subject.system.clone();
        Ok(log.recording(self.effort.sequence)?)
    }

    fn silent(&self, base: Base) -> Result<Model> {
        let Effort { embedding, layers, sequence, seed, .. } = self.effort;
        let scale = if matches!(base, Base::Draft(_)) { NEAR } else { 1.0 };
        let shape = Shape { base, embedding, layers, history: 1, sequence, scale };
        shape.silent(self.subject, "measured", &self.real()?, seed)
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
        let Effort { singles, seed, .. } = self.effort;
        let bar = bar(what, singles);
        let config = UnrollConfig { updates: singles, batch: 32, rate, seed, validate_every: (singles / 16).max(1) };
        let found = single(model, self.subject, recording, config, &worth, &mut |done, best| {
            bar.say(&format!("validation {best:.4}"));
            bar.set(done);
        })?;
        bar.finish();
        Ok(found.0)
    }

    /// A NeRD of the calibrated solver: contact learned from simulations whose parameters differ, from measured starts.
    fn pretrained(&self) -> Result<Model> {
        let mut rng = stream(self.effort.seed, 2);
        let (frames, mut data) = (self.effort.sequence, Data::new(&self.subject.system.robot));
        let mut recording = Recording::empty(frames);
        let whole: Vec<Trial> = self.log_trials(0);
        for _ in 0..WORLDS {
            let value = |(p, v): (&Parameter, &f64)| p.at(p.place(*v) + SPREAD * (2.0 * rng.random::<f64>() - 1.0));
            let values: Vec<f64> = self.parameters.iter().zip(self.values).map(value).collect();
            let world = self.subject.with(self.parameters, &values)?;
            let motions = world.states_in(&whole, &|| world.engine.solver())?;
            for (motion, trial) in motions.iter().zip(&whole) {
                for (states, torques) in motion.windows(frames + 1).zip(trial.torques.windows(frames)).step_by(frames) {
                    recording.push(&self.subject.system, &self.subject.scene, states, torques, &mut data);
                }
            }
        }
        let Effort { embedding, layers, sequence, seed, .. } = self.effort;
        let shape = Shape { base: Base::ExactFlight, embedding, layers, history: 1, sequence, scale: 1.0 };
        let model = shape.silent(self.subject, "calibrated", &recording, seed)?;
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
    pub fn judged(&self, model: &Model, seed: u64) -> Result<(Scored, Scored, Distance)> {
        let of = |trials: &[Trial]| -> Result<Scored> { Ok(Scored::new(trials, &distances(model, self.subject, trials)?, seed)) };
        let simulated = mean(&distances(model, self.subject, &self.simulated()?)?);
        Ok((of(&self.parts.judged)?, of(&self.parts.whole)?, simulated))
    }
}
