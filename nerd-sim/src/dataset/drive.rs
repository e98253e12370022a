//! Drives of random trajectories: random torques every frame, random actions of a position law with random gains,
//! torques along smooth curves, or a policy.

use std::fmt::Debug;

use rand_chacha::ChaCha8Rng;

use crate::{internal::*, system::RandomGains};

/// Random torques of a system, as in its training data.
pub struct Drive {
    amplitudes: Vec<f64>,
    position: Option<Position>,
    action: Vec<f64>,
}

/// A position law with gains drawn every frame.
struct Position {
    controller: Controller,
    own: Vec<[f64; 2]>,
    gains: RandomGains,
}

impl Drive {
    /// The drive of the system's specification.
    pub fn new(system: &Arc<System>) -> Self {
        let position = system.spec.control.and_then(|c| c.data).map(|gains| {
            let controller = Controller::new(system);
            Position { own: controller.gains.clone(), controller, gains }
        });
        let amplitudes = system.torque_amplitudes();
        Self { action: vec![0.0; amplitudes.len()], amplitudes, position }
    }

    /// Torques of a frame at `state`: random torques, or random actions of a position law, times `scale`. For `scale` 0
    /// or below, random torques are zero, and a position law holds its pose with nominal gains. Below -1/2 the position
    /// law gives no torque either. The number of draws does not depend on `scale`, except for gains.
    pub fn draw(&mut self, state: &[f64], scale: f64, rng: &mut impl Rng, out: &mut [f64]) {
        let factor = if scale > 0.0 { scale } else { 0.0 };
        let mut side = || 2.0 * rng.random::<f64>() - 1.0;
        let Some(Position { controller, own, gains }) = &mut self.position else {
            for (tau, a) in out.iter_mut().zip(&self.amplitudes) {
                *tau = if *a == 0.0 { 0.0 } else { factor * a * side() };
            }
            return;
        };
        self.action.iter_mut().for_each(|a| *a = factor * side());
        if scale > 0.0 {
            controller.gains.fill([gains.kp.draw(rng), gains.kd.draw(rng)]);
        } else if scale < -0.5 {
            return out.fill(0.0);
        } else {
            controller.gains.copy_from_slice(own);
        }
        controller.torques(state, &self.action, out);
    }
}

/// Drives some of the trajectories, so that data contains a policy's motions. The `Debug` text must identify everything
/// that determines the data.
pub trait Pilot: Debug + Send + Sync {
    /// Start `[q, qd]` of a trajectory, and the policy that acts in it.
    fn launch(&self, system: &Arc<System>, rng: &mut ChaCha8Rng) -> (Vec<f64>, Box<dyn Act>);
}

/// Acts in one trajectory in place of random torques.
pub trait Act {
    /// Writes the torques of the next frame (N m or N) to `out`, one per joint.
    fn torques(&mut self, state: &[f64], scene: &Scene, rng: &mut ChaCha8Rng, out: &mut [f64]);
}

/// Uniform cubic B-splines with random control values, one curve per joint. Such smooth torques suit robots that follow
/// their torques, such as a gripper under impedance control. The curve of a joint with a spring starts at the torque
/// that holds its start position.
pub struct Smooth {
    amplitudes: Vec<f64>,
    /// The four control values (N m or N) around the present time, for each joint.
    values: Vec<[f64; 4]>,
    /// Number of frames between two control values; `since`: number of frames since the last control value.
    span: usize,
    since: usize,
}

impl Smooth {
    /// Curves of a trajectory from `state`; `None` without `smooth` in the specification or for `scale` 0 or below.
    pub fn new(system: &System, state: &[f64], scale: f64, rng: &mut ChaCha8Rng) -> Option<Self> {
        let pace = system.spec.smooth.filter(|_| scale > 0.0)?;
        let robot = &system.robot;
        let amplitudes: Vec<f64> = system.torque_amplitudes().iter().map(|most| scale * most).collect();
        let joints = robot.joints().zip(&state[robot.root_coords()..]).zip(&amplitudes);
        let held = joints.map(|((joint, q), most)| (joint.stiffness * (q - joint.rest)).clamp(-most.abs(), most.abs()));
        let values = held.map(|torque| [torque; 4]).collect();
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
        let shares = [v * v * v, 3.0 * u * u * u - 6.0 * u * u + 4.0, 3.0 * v * v * v - 6.0 * v * v + 4.0, u * u * u]
            .map(|share| share / 6.0);
        for (tau, values) in out.iter_mut().zip(&self.values) {
            *tau = values.iter().zip(&shares).map(|(value, share)| value * share).sum();
        }
        self.since += 1;
    }
}
