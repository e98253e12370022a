//! Wrappers around a solver, and two solvers without physics. Each is a [`Solver`] itself, so it can take a solver's place anywhere, to
//! time, record or disturb it.
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
//! // The same states once more, without computing them.
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

/// Adds up the time of its solver's frames alone.
#[derive(Clone, Debug)]
pub struct Timed<S = Box<dyn Solver>> {
    /// The solver.
    pub solver: S,
    /// Time its frames have taken; set it to zero to restart.
    pub spent: Duration,
}

impl<S: Solver> Timed<S> {
    /// Around a solver, from zero.
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

/// Keeps every state of its solver after a frame; [`Replay`] plays them back.
#[derive(Clone, Debug)]
pub struct Recorder<S = Box<dyn Solver>> {
    /// The solver.
    pub solver: S,
    /// States `[env][q, qd]` after each frame.
    pub frames: Vec<Vec<f64>>,
}

impl<S: Solver> Recorder<S> {
    /// Around a solver; nothing is kept yet.
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

/// Adds normal noise (rad/s or m/s, to each velocity) after each frame of a solver. It shows how far a motion's own sensitivity amplifies
/// small differences. A model whose error is no larger than its disturbed truth's has nothing left to learn.
#[derive(Clone, Debug)]
pub struct Shaken<S = Box<dyn Solver>> {
    solver: S,
    noise: f64,
    seed: u64,
    frame: u64,
}

impl<S: Solver> Shaken<S> {
    /// Adds noise of this standard deviation after each frame; frame t has a stream of its own, keyed by (seed, t).
    pub fn new(solver: S, noise: f64, seed: u64) -> Self {
        Self { solver, noise, seed, frame: 0 }
    }
}

impl<S: Solver> Solver for Shaken<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(batch, torques)?;
        let (mut rng, robot) = (stream(self.seed, self.frame), &batch.system.robot);
        self.frame += 1;
        for state in batch.states.chunks_exact_mut(robot.state_dim()) {
            state[robot.nq()..].iter_mut().for_each(|v| *v += self.noise * normal(&mut rng));
        }
        Ok(())
    }

    around!();
}

/// Plays recorded states back, whatever the torques: a reference that costs nothing to evaluate again.
#[derive(Clone, Debug)]
pub struct Replay<'a> {
    /// States `[env][q, qd]` by frame, as [`Recorder`] keeps them.
    pub frames: &'a [Vec<f64>],
    /// The next frame.
    pub next: usize,
}

impl<'a> Replay<'a> {
    /// From the first frame on.
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

/// Keeps every state: the baseline of knowing nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hold;

impl Solver for Hold {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        commit(batch, &mut next, &mut Vec::new())
    }
}

/// Continues at the present velocity: better than [`Hold`] for a few frames, mostly worse for many.
#[derive(Clone, Copy, Debug, Default)]
pub struct Glide;

impl Solver for Glide {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        let (d, time) = (batch.system.robot.state_dim(), batch.system.frame_time);
        next.chunks_exact_mut(d).for_each(|state| glide(&batch.system, state, time));
        commit(batch, &mut next, &mut Vec::new())
    }
}

/// Advances a state `[q, qd]` by `time` (s) at constant joint velocities, angular velocity and velocity of the root. Endless angles are not
/// wrapped.
pub fn glide(system: &System, state: &mut [f64], time: f64) {
    let (q, qd) = system.robot.split(state);
    qd.to_local(&system.robot, q).advance(&system.robot, state, time);
}
