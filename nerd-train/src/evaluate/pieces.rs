//! Rollouts beside recorded motion, of a log or of robots of a family.

use nerd_sim::dataset::{GenerateConfig, begin, record};

use super::tally::{PassiveReport, Tally};
use crate::prelude::*;

/// Pieces of recorded trajectories of equal length, side by side.
#[derive(Clone)]
pub struct Pieces {
    /// The robot, as the solver is to have it.
    pub system: Arc<System>,
    /// The robot of each piece, where they differ.
    pub systems: Vec<Arc<System>>,
    /// Where each was.
    pub scenes: Vec<Arc<Scene>>,
    /// Frames that a solver is shown before it goes on alone.
    pub before: usize,
    /// States `[frame][piece][q, qd]`, one more than frames.
    pub states: Vec<Vec<f64>>,
    /// Torques `[frame][piece][joint]`.
    pub torques: Vec<Vec<f64>>,
}

impl Pieces {
    /// Trajectories `0 .. count` of data of a truth, of robots of their own where something is drawn of them, of which a solver is shown so
    /// many frames as sensors have them. The start of what it goes alone, and what it is compared with, are without their noise.
    ///
    /// # Errors
    /// If that cannot be recorded, or is no longer than what is shown.
    pub fn drawn(system: &Arc<System>, truth: Truth, config: &GenerateConfig, before: usize) -> Result<Self> {
        if before >= config.frames {
            refuse!("{} frames: more than the {before} that are seen are needed", config.frames);
        }
        let (count, f) = (config.trajectories(), config.frames);
        let made = record(system, &mut *truth.solver(system), config, 0, count)?;
        let begun = begin(system, config, 0, count)?;
        let frames = |x: &[f64], rows: usize| -> Vec<Vec<f64>> {
            let width = x.len() / (count * rows);
            let row = |frame: usize| (0..count).flat_map(|k| x[(k * rows + frame) * width..][..width].to_vec()).collect();
            (0..rows).map(row).collect()
        };
        let (mut states, torques) = (frames(&made.states, f + 1), frames(&made.torques, f));
        if !made.shown.is_empty() {
            states[..before].clone_from_slice(&frames(&made.shown, f)[..before]);
        }
        Ok(Self { system: system.clone(), systems: begun.systems, scenes: begun.scenes, before, states, torques })
    }

    /// The same pieces, with the solver's history cut to its last `before` frames (at most all of them).
    pub fn seen(&self, before: usize) -> Self {
        let skip = self.before.saturating_sub(before);
        let (states, torques) = (self.states[skip..].to_vec(), self.torques[skip..].to_vec());
        Self { before: self.before - skip, states, torques, ..self.clone() }
    }

    /// The same as a solver has them that knows the robot as its files have it, in scenes of its material.
    pub fn described(&self) -> Self {
        let own = |scene: &Arc<Scene>| {
            let mut scene = (**scene).clone();
            scene.gravity = self.system.gravity();
            scene.colliders.iter_mut().for_each(|c| c.material = self.system.spec.material);
            Arc::new(scene)
        };
        Self { systems: Vec::new(), scenes: self.scenes.iter().map(own).collect(), ..self.clone() }
    }

    /// The same as a solver has them that is told what was drawn, but for ripples.
    pub fn told(&self) -> Self {
        let told = |own: &Arc<System>| {
            let mut own = (**own).clone();
            own.motors.ripple.clear();
            Arc::new(own)
        };
        Self { systems: self.systems.iter().map(told).collect(), ..self.clone() }
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.scenes.len()
    }

    /// Frames that a solver goes alone.
    pub fn frames(&self) -> usize {
        self.torques.len() - self.before
    }

    /// Errors of a solver that is shown the first frames and rolls out the others.
    ///
    /// # Errors
    /// If it can step none, or one of those that it is shown.
    pub fn compare(&self, solver: &mut dyn Solver) -> Result<PassiveReport, StepError> {
        let (n, d) = (self.count(), self.system.robot.state_dim());
        let mut batch = Batch::new(&self.system, &self.scenes[0], n);
        (batch.systems, batch.scenes) = (self.systems.clone(), self.scenes.clone());
        for env in 0..n {
            batch.reset(env, &self.states[0][env * d..(env + 1) * d]);
            solver.reset(env);
        }
        for frame in 0..self.before {
            solver.step(&mut batch, &self.torques[frame])?;
            // As it was, whatever the solver thinks; what remembers takes it for the next frame.
            batch.states.copy_from_slice(&self.states[frame + 1]);
        }
        let (first, mut tally) = (&self.states[self.before], Tally::new(&self.system, n));
        for frame in self.before..self.torques.len() {
            tally.step(solver, (&mut batch, &self.torques[frame]), [&self.states[frame + 1], first])?;
        }
        Ok(tally.report(self.frames()))
    }
}
