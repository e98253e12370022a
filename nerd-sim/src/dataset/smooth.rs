//! Random torques along smooth curves, for robots that follow their torques, such as a gripper under impedance control.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::drive::Effort;
use super::pilot::Act;
use crate::scene::Scene;
use crate::system::System;

/// Uniform cubic B-splines through random values, one curve a joint. A sprung joint's begins at rest: with the torque that holds it where
/// it starts.
pub struct Smooth {
    amplitudes: Vec<f64>,
    /// The four values around the present, joint by joint.
    values: Vec<[f64; 4]>,
    /// Frames from one value to the next, and those since the last.
    span: usize,
    since: usize,
}

impl Smooth {
    /// Curves of a trajectory from `state`, where the specification asks for them and it is driven.
    pub fn new(system: &System, state: &[f64], effort: Effort, rng: &mut ChaCha8Rng) -> Option<Self> {
        let (Some(pace), Effort::Driven(scale)) = (system.spec.smooth, effort) else { return None };
        let robot = &system.robot;
        let amplitudes: Vec<f64> = system.torque_amplitudes().iter().map(|most| scale * most).collect();
        let start = |((joint, q), most): ((&nerd_core::robot::Joint, &f64), &f64)| {
            let held = joint.stiffness * (q - joint.rest);
            [held.clamp(-most.abs(), most.abs()); 4]
        };
        let values = robot.joints().zip(&state[robot.root_coords()..]).zip(&amplitudes).map(start).collect();
        let span = ((pace.draw(rng) / system.frame_time).round() as usize).max(1);
        Some(Self { amplitudes, values, span, since: span })
    }
}

impl Act for Smooth {
    fn torques(&mut self, _: &[f64], _: &Scene, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        if self.since == self.span {
            self.since = 0;
            for (values, most) in self.values.iter_mut().zip(&self.amplitudes) {
                values.rotate_left(1);
                values[3] = most * (2.0 * rng.random::<f64>() - 1.0);
            }
        }
        let u = self.since as f64 / self.span as f64;
        let v = 1.0 - u;
        let shares =
            [v * v * v, 3.0 * u * u * u - 6.0 * u * u + 4.0, 3.0 * v * v * v - 6.0 * v * v + 4.0, u * u * u].map(|share| share / 6.0);
        for (tau, values) in out.iter_mut().zip(&self.values) {
            *tau = values.iter().zip(&shares).map(|(value, share)| value * share).sum();
        }
        self.since += 1;
    }
}
