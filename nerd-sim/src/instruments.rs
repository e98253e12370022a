//! Wrappers around a solver that time, record or disturb it, and two solvers without physics. Each wrapper is itself a
//! [`Solver`], so a wrapper can replace a solver anywhere.
//!
//! ```
//! use nerd_sim::instruments::{Recorder, Replay, Shaken, Timed};
//! use nerd_sim::prelude::*;
//! let system = System::named("cartpole")?;
//! let scene = system.scene("free")?;
//! let solver = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
//! let mut timed = Timed::new(Recorder::new(Shaken::new(solver, 0.01, 7)));
//! let mut batch = Batch::new(&system, &scene, 3);
//! for _ in 0..10 {
//!     timed.step(&mut batch, &[0.0; 6])?;
//! }
//! println!("{:?} for ten frames of three environments", timed.spent);
//!
//! // The same states again, without computing them.
//! let frames = timed.solver.frames;
//! let (mut replay, mut again) = (Replay::new(&frames), Batch::new(&system, &scene, 3));
//! for _ in 0..10 {
//!     replay.step(&mut again, &[0.0; 6])?;
//! }
//! assert_eq!(batch.states, again.states);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::time::{Duration, Instant};

use crate::solver::{around, commit};
use crate::{internal::*, sampling::normal};

/// Sums the wall time of a solver's frames.
#[derive(Clone, Debug)]
pub struct Timed<S = Box<dyn Solver>> {
    /// The wrapped solver.
    pub solver: S,
    /// Wall time that frames have taken; set this to zero to restart.
    pub spent: Duration,
}

impl<S: Solver> Timed<S> {
    /// Wraps a solver; the time starts at zero.
    pub fn new(solver: S) -> Self {
        Self { solver, spent: Duration::ZERO }
    }
}

impl<S: Solver> Solver for Timed<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let start = Instant::now();
        let done = self.solver.step(batch, torques);
        self.spent += start.elapsed();
        done
    }

    around!();
}

/// Records every state of its solver after a frame; [`Replay`] plays the states back.
#[derive(Clone, Debug)]
pub struct Recorder<S = Box<dyn Solver>> {
    /// The wrapped solver.
    pub solver: S,
    /// States `[env][q, qd]` after each frame.
    pub frames: Vec<Vec<f64>>,
}

impl<S: Solver> Recorder<S> {
    /// Wraps a solver; the record is empty.
    pub fn new(solver: S) -> Self {
        Self { solver, frames: Vec::new() }
    }
}

impl<S: Solver> Solver for Recorder<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let done = self.solver.step(batch, torques);
        // Failed environments keep their states; the frame counts for the others.
        if matches!(done, Ok(()) | Err(StepError::Environments(_))) {
            self.frames.push(batch.states.clone());
        }
        done
    }

    around!();
}

/// Adds normal noise (rad/s or m/s) to each velocity after each frame of a solver. The result shows how far the motion
/// itself amplifies small differences. A model with no more error than the disturbed truth cannot improve further.
#[derive(Clone, Debug)]
pub struct Shaken<S = Box<dyn Solver>> {
    solver: S,
    noise: f64,
    seed: u64,
    frame: u64,
}

impl<S: Solver> Shaken<S> {
    /// Wraps a solver; `noise` is the standard deviation. The noise of frame t has its own stream, keyed by (seed, t).
    pub fn new(solver: S, noise: f64, seed: u64) -> Self {
        Self { solver, noise, seed, frame: 0 }
    }
}

impl<S: Solver> Solver for Shaken<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(batch, torques)?;
        let mut rng = stream(self.seed, self.frame);
        let robot = &batch.system.robot;
        self.frame += 1;
        for state in batch.states.chunks_exact_mut(robot.state_dim()) {
            state[robot.nq()..].iter_mut().for_each(|v| *v += self.noise * normal(&mut rng));
        }
        Ok(())
    }

    around!();
}

/// Plays recorded states back and ignores torques: a reference without the cost of a second evaluation.
#[derive(Clone, Debug)]
pub struct Replay<'a> {
    /// States `[env][q, qd]` by frame, as recorded by [`Recorder`].
    pub frames: &'a [Vec<f64>],
    /// Index of the next frame.
    pub next: usize,
}

impl<'a> Replay<'a> {
    /// Starts at the first frame.
    pub fn new(frames: &'a [Vec<f64>]) -> Self {
        Self { frames, next: 0 }
    }
}

impl Solver for Replay<'_> {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let refused = |why: String| Err(StepError::Solver(format!("frame {} of a replay: {why}", self.next)));
        match self.frames.get(self.next) {
            None => return refused(format!("only {} were recorded", self.frames.len())),
            Some(frame) if frame.len() != batch.states.len() => {
                return refused(format!("{} numbers were recorded, the batch has {}", frame.len(), batch.states.len()));
            }
            Some(frame) => batch.states.copy_from_slice(frame),
        }
        self.next += 1;
        batch.frames.iter_mut().for_each(|f| *f += 1);
        Ok(())
    }
}

/// Keeps every state unchanged: the baseline without a prediction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hold;

impl Solver for Hold {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        commit(batch, &mut next, &mut Vec::new())
    }
}

/// Advances positions at constant velocity: better than [`Hold`] for a few frames, mostly worse for many.
#[derive(Clone, Copy, Debug, Default)]
pub struct Glide;

impl Solver for Glide {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        let d = batch.system.robot.state_dim();
        let time = batch.system.frame_time;
        next.chunks_exact_mut(d).for_each(|state| glide(&batch.system, state, time));
        commit(batch, &mut next, &mut Vec::new())
    }
}

/// Advances a state `[q, qd]` by `time` (s) at constant joint velocities, and constant angular velocity and velocity of
/// the root. Angles of joints without limits are not wrapped.
pub fn glide(system: &System, state: &mut [f64], time: f64) {
    let (q, qd) = system.robot.split(state);
    qd.to_local(&system.robot, q).advance(&system.robot, state, time);
}
