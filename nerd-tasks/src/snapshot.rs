//! Snapshots of running episodes, and records of frames. Episodes continue exactly from a snapshot, on any solver.
//!
//! An analytic solver needs only the states. A learned solver's memory depends on the last frames. So the last frames
//! are saved too, and [`Past::replay`] steps the solver through them again.

use std::collections::VecDeque;

use nerd_sim::solver::{Simulation, StepError};
use nerd_sim::system::System;
use rayon::prelude::*;

/// Fewest numbers that one thread copies. Copies are parallel, since a step of thousands of environments moves
/// megabytes.
pub(crate) const MOVED: usize = 1 << 14;

/// Everything in [`crate::Episodes`] that later steps depend on; row-major over n environments.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// States `[n][q, qd]`.
    pub states: Vec<f64>,
    /// Frames since each reset, `[n]`.
    pub frames: Vec<u64>,
    /// Goals `[n][goal_dim]`.
    pub goals: Vec<f64>,
    /// Episodes started in each environment, `[n]`; with the seed they determine the next draws.
    pub begun: Vec<u64>,
    /// States before each of the last frames, oldest first, `[frames][n][q, qd]`.
    pub past_states: Vec<f64>,
    /// Torques of each of the last frames, `[frames][n][joints]`.
    pub past_torques: Vec<f64>,
}

/// A record of consecutive frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// States before each frame, `[frame][env][q, qd]`.
    pub states: Vec<f64>,
    /// Goals in each frame, `[frame][env][goal_dim]`.
    pub goals: Vec<f64>,
    /// Torques over each frame, `[frame][env][joint]`.
    pub torques: Vec<f64>,
    /// States after each step, before ended episodes restarted, `[step][env][q, qd]`; NaN where the solver failed.
    pub reached: Vec<f64>,
}

/// The last frames: the states before each frame, and the torques in it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Past {
    pub(crate) most: usize,
    frames: VecDeque<(Vec<f64>, Vec<f64>)>,
}

impl Past {
    /// Keeps as many frames as the largest delay of observations.
    pub(crate) fn for_lag(system: &System) -> Self {
        let lag = system.spec.vary.as_ref().and_then(|vary| vary.lag);
        Self { most: lag.map_or(0, |lag| lag.high.round() as usize), ..Self::default() }
    }

    /// State of an environment (`width` numbers) `frames` frames ago; `None` for 0 frames, or if that frame is not
    /// stored.
    pub(crate) fn ago(&self, frames: usize, env: usize, width: usize) -> Option<&[f64]> {
        let (states, _) = self.frames.get(self.frames.len().checked_sub(frames)?)?;
        Some(&states[env * width..(env + 1) * width])
    }

    /// Stores states and torques of the next frame.
    pub(crate) fn push(&mut self, states: &[f64], torques: &[f64]) {
        if self.most == 0 {
            return;
        }
        let mut oldest =
            if self.frames.len() >= self.most { self.frames.pop_front() } else { None }.unwrap_or_default();
        for (kept, now) in [(&mut oldest.0, states), (&mut oldest.1, torques)] {
            kept.clear();
            kept.par_extend(now.par_iter().with_min_len(MOVED).copied());
        }
        self.frames.push_back(oldest);
    }

    pub(crate) fn write(&self, snapshot: &mut Snapshot) {
        snapshot.past_states = self.frames.iter().flat_map(|f| &f.0).copied().collect();
        snapshot.past_torques = self.frames.iter().flat_map(|f| &f.1).copied().collect();
    }

    pub(crate) fn read(&mut self, snapshot: &Snapshot, joints: usize) {
        let states = snapshot.states.len();
        let torques = snapshot.frames.len() * joints;
        self.frames.clear();
        let frames =
            snapshot.past_states.chunks_exact(states.max(1)).zip(snapshot.past_torques.chunks_exact(torques.max(1)));
        frames.for_each(|(s, t)| self.frames.push_back((s.to_vec(), t.to_vec())));
    }

    /// Steps the solver through the stored frames, then restores the simulation's states.
    pub(crate) fn replay(&self, simulation: &mut Simulation) -> Result<(), StepError> {
        let (states, frames) = (simulation.batch.states.clone(), simulation.batch.frames.clone());
        for (k, (before, torques)) in self.frames.iter().enumerate() {
            let ago = (self.frames.len() - k) as u64;
            simulation.batch.states.copy_from_slice(before);
            // Frames of an earlier episode are stepped too; frame 0 of the present episode clears the solver's memory.
            let count = |now: &u64| now.checked_sub(ago).unwrap_or(u64::MAX / 2 - ago);
            simulation.batch.frames = frames.iter().map(count).collect();
            // An environment that failed in this frame fails again. The episodes restarted it afterwards, so the
            // failure is ignored.
            if let Err(error) = simulation.step(torques) {
                error.faults()?;
            }
        }
        simulation.batch.states = states;
        simulation.batch.frames = frames;
        Ok(())
    }
}
