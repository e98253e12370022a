//! The gripper that leads a chain: its state, its motion within a frame, and the direction it points to.

use super::Chain;
use crate::prelude::*;

/// State of a gripper; in an adjoint, the gradients with respect to these numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gripper {
    /// Position (m, world).
    pub at: Vector3<f64>,
    /// Its rate (m/s).
    pub velocity: Vector3<f64>,
    /// Yaw, pitch, roll (rad), applied in this order.
    pub angles: Vector3<f64>,
    /// Their rates (rad/s).
    pub rates: Vector3<f64>,
}

impl Gripper {
    /// Its numbers: position, velocity, angles, rates.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        [self.at, self.velocity, self.angles, self.rates].into_iter().flat_map(|v| [v.x, v.y, v.z])
    }

    /// The same, to be written.
    pub fn numbers_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        [&mut self.at, &mut self.velocity, &mut self.angles, &mut self.rates].into_iter().flat_map(|v| v.iter_mut())
    }

    /// Direction of the gripper's x axis (world, unit length), `t = (cos y cos p, sin y cos p, -sin p)` for yaw y and pitch p, and its rate
    /// (1/s).
    pub fn points(&self) -> [Vector3<f64>; 2] {
        let [t, by_yaw, by_pitch, ..] = self.slopes();
        [t, by_yaw * self.rates.x + by_pitch * self.rates.y]
    }

    /// t, its derivatives with respect to yaw and pitch, and the second ones: yaw twice, yaw and pitch, pitch twice.
    fn slopes(&self) -> [Vector3<f64>; 6] {
        let ((sy, cy), (sp, cp)) = (self.angles.x.sin_cos(), self.angles.y.sin_cos());
        [
            Vector3::new(cy * cp, sy * cp, -sp),
            Vector3::new(-sy * cp, cy * cp, 0.0),
            Vector3::new(-cy * sp, -sy * sp, -cp),
            Vector3::new(-cy * cp, -sy * cp, 0.0),
            Vector3::new(sy * sp, -cy * sp, 0.0),
            Vector3::new(-cy * cp, -sy * cp, sp),
        ]
    }

    /// Adjoint of [`Gripper::points`]: adds to `slope`.
    pub fn points_back(&self, upstream: [Vector3<f64>; 2], slope: &mut Self) {
        let [_, by_yaw, by_pitch, yaw_yaw, yaw_pitch, pitch_pitch] = self.slopes();
        let [t, rate] = upstream;
        slope.angles.x += by_yaw.dot(&t) + (yaw_yaw * self.rates.x + yaw_pitch * self.rates.y).dot(&rate);
        slope.angles.y += by_pitch.dot(&t) + (yaw_pitch * self.rates.x + pitch_pitch * self.rates.y).dot(&rate);
        slope.rates.x += by_yaw.dot(&rate);
        slope.rates.y += by_pitch.dot(&rate);
    }
}

impl Chain {
    /// A frame of the gripper under its drives alone, in closed form. With `e` the distance from `torque / stiffness` and `w` the natural
    /// frequency, `e' = (e + (v + w e) dt) exp(-w dt)`, `v' = (v - w (v + w e) dt) exp(-w dt)`. `torques` (N, N m) act on its six axes.
    pub fn glide(&self, gripper: &Gripper, torques: &[f64]) -> Gripper {
        let mut next = *gripper;
        for (k, torque) in torques.iter().enumerate().take(6) {
            let (home, [x, v]) = (if k < 3 { self.home[k] } else { 0.0 }, axis(&mut next, k));
            let (goal, w) = (torque / self.stiffness[k] + home, self.pulse[k]);
            let (e, fade) = (*x - goal, (-w * self.frame_time).exp());
            let pull = *v + w * e;
            *x = goal + (e + pull * self.frame_time) * fade;
            *v = (*v - w * pull * self.frame_time) * fade;
        }
        next
    }

    /// Adjoint of [`Chain::glide`], which is linear: gradients with respect to its input from the upstream ones.
    pub fn glide_back(&self, upstream: &Gripper) -> Gripper {
        let mut slope = *upstream;
        for k in 0..6 {
            let (w, dt, [x, v]) = (self.pulse[k], self.frame_time, axis(&mut slope, k));
            let fade = (-w * dt).exp();
            (*x, *v) = ((*x * (1.0 + w * dt) - *v * w * w * dt) * fade, (*x * dt + *v * (1.0 - w * dt)) * fade);
        }
        slope
    }
}

/// Coordinate and rate of one of the six axes.
fn axis(gripper: &mut Gripper, k: usize) -> [&mut f64; 2] {
    let Gripper { at, velocity, angles, rates } = gripper;
    if k < 3 { [&mut at[k], &mut velocity[k]] } else { [&mut angles[k - 3], &mut rates[k - 3]] }
}
