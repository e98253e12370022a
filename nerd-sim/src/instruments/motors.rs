//! Motors with delay and lag, in front of any solver.
//!
//! A torque u commanded at time t arrives at `t + delay`; the motor's torque then follows it as `lag dx/dt = u - x`. A solver holds one
//! torque over a frame, so it gets the mean of x over the frame, which has the same impulse.
//!
//! ```
//! # use nerd_sim::{instruments::{Motor, Motors}, prelude::*};
//! # let system = System::named("pendulum")?;
//! # let mut batch = Batch::new(&system, &system.scene("free")?, 1);
//! let solver = Articulated::new(ArticulatedConfig::accurate(&system));
//! let mut solver = Motors::new(solver, Motor { delay: 0.005, lag: 0.02 })?;
//! solver.step(&mut batch, &[5.0, 0.0])?;
//! assert!(solver.torques()[0] > 0.0 && solver.torques()[0] < 5.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use serde::{Deserialize, Serialize};

use crate::batch::Batch;
use crate::range::within;
use crate::solver::{Capabilities, Solver, StepError};

/// One kind of motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Motor {
    /// Time (s) until it hears.
    pub delay: f64,
    /// Time constant (s) of its torque; 0: at once.
    pub lag: f64,
}

/// A solver behind motors, one at every joint. They begin without torque, having been asked for none.
#[derive(Clone, Debug)]
pub struct Motors<S = Box<dyn Solver>> {
    solver: S,
    motor: Motor,
    joints: usize,
    /// Torques asked for, by frame, the last one first: `[frame][env][joint]`.
    asked: Vec<Vec<f64>>,
    /// Torques of the motors at the end of the last frame, and their means over it.
    now: Vec<f64>,
    means: Vec<f64>,
}

impl<S: Solver> Motors<S> {
    /// Puts motors before a solver.
    ///
    /// # Errors
    /// A time that is negative or longer than a minute.
    pub fn new(solver: S, motor: Motor) -> Result<Self, String> {
        within("a motor's delay", motor.delay, 0.0..=60.0, "s")?;
        within("a motor's lag", motor.lag, 0.0..=60.0, "s")?;
        Ok(Self { solver, motor, joints: 0, asked: Vec::new(), now: Vec::new(), means: Vec::new() })
    }

    /// Torques that the solver was given in the last frame, `[env][joint]` (N m or N).
    pub fn torques(&self) -> &[f64] {
        &self.means
    }
}

impl<S: Solver> Solver for Motors<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let h = batch.system.frame_time;
        // In the first part of the frame a motor hears what was asked for a frame earlier than in the rest.
        let frames = (self.motor.delay / h).floor();
        let part = self.motor.delay / h - frames;
        if self.now.len() != torques.len() {
            self.asked = vec![vec![0.0; torques.len()]; frames as usize + 2];
            self.now = vec![0.0; torques.len()];
            self.joints = batch.system.robot.joint_count();
        }
        self.asked.rotate_right(1);
        self.asked[0].copy_from_slice(torques);
        self.means.clear();
        for (i, x) in self.now.iter_mut().enumerate() {
            let mut mean = 0.0;
            for (k, share) in [(frames as usize + 1, part), (frames as usize, 1.0 - part)] {
                let (end, over) = follow(*x, self.asked[k][i], share * h, self.motor.lag);
                mean += share * over;
                *x = end;
            }
            self.means.push(mean);
        }
        self.solver.step(batch, &self.means)
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
        // Before the first step there is nothing to forget.
        let own = env * self.joints..(env + 1) * self.joints;
        if own.end <= self.now.len() {
            self.asked.iter_mut().for_each(|frame| frame[own.clone()].fill(0.0));
            self.now[own].fill(0.0);
        }
    }

    fn capabilities(&self) -> Capabilities {
        self.solver.capabilities()
    }
}

/// From x towards u over a time: where it ends, and its mean on the way.
fn follow(x: f64, u: f64, time: f64, lag: f64) -> (f64, f64) {
    if lag == 0.0 || time == 0.0 {
        return if time == 0.0 { (x, x) } else { (u, u) };
    }
    let z = time / lag;
    // 1 - e^-z, exactly for small z.
    let gone = -(-z).exp_m1();
    (u + (x - u) * (1.0 - gone), u + (x - u) * gone / z)
}
