//! Rollouts compared with recorded motion, from a log or from robots of a family.

use nerd_sim::dataset::record;

use super::tally::{PassiveReport, Tally};
use crate::prelude::*;

/// Recorded trajectories as the truth, one per environment.
#[derive(Clone)]
pub struct Pieces {
    /// The robot with nominal parameters.
    pub system: Arc<System>,
    /// Frames of history shown to a solver before its rollout.
    pub before: usize,
    /// The trajectories with their scenes and robots.
    pub all: Trajectories,
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
        let mut all = record(system, &mut *truth.solver(system), config, 0, config.trajectories())?;
        let (d, f) = (system.robot.state_dim(), all.frames);
        for (states, shown) in all.states.chunks_mut((f + 1) * d).zip(all.shown.chunks(f * d)) {
            states[..before * d].copy_from_slice(&shown[..before * d]);
        }
        Ok(Self { system: system.clone(), before, all: all.bare() })
    }

    /// The same pieces with only the last `before` frames of history (at most all of them).
    pub fn seen(&self, before: usize) -> Self {
        let skip = self.before.saturating_sub(before);
        Self { system: self.system.clone(), before: self.before - skip, all: self.all.after(skip) }
    }

    /// The same pieces for a solver that knows only the robot's file: nominal parameters, gravity and contact material.
    pub fn described(&self) -> Self {
        let own = |scene: &Arc<Scene>| {
            let mut scene = (**scene).clone();
            scene.gravity = self.system.gravity();
            scene.colliders.iter_mut().for_each(|c| c.material = self.system.spec.material);
            Arc::new(scene)
        };
        let scenes = self.all.scenes.iter().map(own).collect();
        Self { all: Trajectories { systems: Vec::new(), scenes, ..self.all.clone() }, ..self.clone() }
    }

    /// The same pieces for a solver that knows the drawn parameters, except torque ripple.
    pub fn told(&self) -> Self {
        let told = |own: &Arc<System>| {
            let mut own = (**own).clone();
            own.motors.ripple.clear();
            Arc::new(own)
        };
        let mut pieces = self.clone();
        pieces.all.systems = self.all.systems.iter().map(told).collect();
        pieces
    }

    /// Number of pieces.
    pub fn count(&self) -> usize {
        self.all.count
    }

    /// Frames of a rollout after its history.
    pub fn frames(&self) -> usize {
        self.all.frames - self.before
    }

    /// Rolls out a solver after the shown history and returns its errors against the recorded states.
    ///
    /// # Errors
    /// If the solver fails as a whole, or in a frame of the history.
    pub fn compare(&self, solver: &mut dyn Solver) -> Result<PassiveReport, StepError> {
        let (all, mut batch) = (&self.all, self.all.begun(&self.system));
        (0..all.count).for_each(|env| solver.reset(env));
        for frame in 0..self.before {
            solver.step(&mut batch, &all.torques_at(frame))?;
            // The recorded state replaces the prediction; a solver with memory sees the recorded one in the next frame.
            batch.states = all.states_at(frame + 1);
        }
        let (first, mut tally) = (all.states_at(self.before), Tally::new(&self.system, all.count));
        for frame in self.before..all.frames {
            tally.step(solver, (&mut batch, &all.torques_at(frame)), [&all.states_at(frame + 1), &first])?;
        }
        Ok(tally.report(self.frames()))
    }
}
