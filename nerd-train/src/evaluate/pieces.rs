//! Rollouts compared with recorded motion, from a log or from robots of a family.

use nerd_sim::dataset::{GenerateConfig, begin, record};

use super::tally::{PassiveReport, Tally};
use crate::prelude::*;

/// Pieces of recorded trajectories, all equally long, one per environment.
#[derive(Clone)]
pub struct Pieces {
    /// The robot with nominal parameters.
    pub system: Arc<System>,
    /// The robot of each piece; empty if all are `system`.
    pub systems: Vec<Arc<System>>,
    /// The scene of each piece.
    pub scenes: Vec<Arc<Scene>>,
    /// Frames of history shown to a solver before its rollout.
    pub before: usize,
    /// States `[frame][piece][q, qd]`, one frame more than of torques.
    pub states: Vec<Vec<f64>>,
    /// Torques `[frame][piece][joint]`.
    pub torques: Vec<Vec<f64>>,
}

impl Pieces {
    /// Pieces of the trajectories that `config` records with `truth`; varied parameters are drawn per trajectory. The
    /// first `before` states are sensor readings with noise. Later states, from the start of the rollout on, have no
    /// noise.
    ///
    /// # Errors
    /// If recording fails, or a trajectory has no frame after the first `before`.
    pub fn drawn(system: &Arc<System>, truth: Truth, config: &GenerateConfig, before: usize) -> Result<Self> {
        if before >= config.frames {
            refuse!("{} frames: more than the {before} that are seen are needed", config.frames);
        }
        let (count, f) = (config.trajectories(), config.frames);
        let made = record(system, &mut *truth.solver(system), config, 0, count)?;
        let begun = begin(system, config, 0, count)?;
        let frames = |x: &[f64], rows: usize| -> Vec<Vec<f64>> {
            let width = x.len() / (count * rows);
            let row =
                |frame: usize| (0..count).flat_map(|k| x[(k * rows + frame) * width..][..width].to_vec()).collect();
            (0..rows).map(row).collect()
        };
        let (mut states, torques) = (frames(&made.states, f + 1), frames(&made.torques, f));
        if !made.shown.is_empty() {
            states[..before].clone_from_slice(&frames(&made.shown, f)[..before]);
        }
        Ok(Self { system: system.clone(), systems: begun.systems, scenes: begun.scenes, before, states, torques })
    }

    /// The same pieces with only the last `before` frames of history (at most all of them).
    pub fn seen(&self, before: usize) -> Self {
        let skip = self.before.saturating_sub(before);
        let (states, torques) = (self.states[skip..].to_vec(), self.torques[skip..].to_vec());
        Self { before: self.before - skip, states, torques, ..self.clone() }
    }

    /// The same pieces for a solver that knows only the robot's file: nominal parameters, gravity and contact material.
    pub fn described(&self) -> Self {
        let own = |scene: &Arc<Scene>| {
            let mut scene = (**scene).clone();
            scene.gravity = self.system.gravity();
            scene.colliders.iter_mut().for_each(|c| c.material = self.system.spec.material);
            Arc::new(scene)
        };
        Self { systems: Vec::new(), scenes: self.scenes.iter().map(own).collect(), ..self.clone() }
    }

    /// The same pieces for a solver that knows the drawn parameters, except torque ripple.
    pub fn told(&self) -> Self {
        let told = |own: &Arc<System>| {
            let mut own = (**own).clone();
            own.motors.ripple.clear();
            Arc::new(own)
        };
        Self { systems: self.systems.iter().map(told).collect(), ..self.clone() }
    }

    /// Number of pieces.
    pub fn count(&self) -> usize {
        self.scenes.len()
    }

    /// Frames of a rollout after its history.
    pub fn frames(&self) -> usize {
        self.torques.len() - self.before
    }

    /// Rolls out a solver after the shown history and returns its errors against the recorded states.
    ///
    /// # Errors
    /// If the solver fails as a whole, or in a frame of the history.
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
            // The recorded state replaces the prediction; a solver with memory sees the recorded one in the next frame.
            batch.states.copy_from_slice(&self.states[frame + 1]);
        }
        let (first, mut tally) = (&self.states[self.before], Tally::new(&self.system, n));
        for frame in self.before..self.torques.len() {
            tally.step(solver, (&mut batch, &self.torques[frame]), [&self.states[frame + 1], first])?;
        }
        Ok(tally.report(self.frames()))
    }
}
