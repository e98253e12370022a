//! The gripper that leads a chain: its state, its motion within a frame, and the direction of its x axis.

use super::Chain;
use crate::prelude::*;

/// State of a gripper. In an adjoint pass, the fields hold gradients with respect to these numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gripper {
    /// Position (m, world).
    pub at: Vector3<f64>,
    /// Velocity (m/s).
    pub velocity: Vector3<f64>,
    /// Yaw, pitch, roll (rad), applied in this order.
    pub angles: Vector3<f64>,
    /// Rates of the angles (rad/s).
    pub rates: Vector3<f64>,
}

impl Gripper {
    /// The twelve numbers: position, velocity, angles, rates.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        [self.at, self.velocity, self.angles, self.rates].into_iter().flat_map(|v| [v.x, v.y, v.z])
    }

    /// As `Self::numbers`, mutable.
    pub fn numbers_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        [&mut self.at, &mut self.velocity, &mut self.angles, &mut self.rates].into_iter().flat_map(|v| v.iter_mut())
    }

    /// Direction t of the gripper's x axis (world, unit length), then the rate of t (1/s). For yaw y and pitch p,
    /// `t = (cos y cos p, sin y cos p, -sin p)`.
    pub fn points(&self) -> [Vector3<f64>; 2] {
        let [t, by_yaw, by_pitch, ..] = self.gradients();
        [t, by_yaw * self.rates.x + by_pitch * self.rates.y]
    }

    /// The direction t of the x axis, its first derivatives by yaw and pitch, then its second ones: yaw-yaw, yaw-pitch,
    /// pitch-pitch.
    fn gradients(&self) -> [Vector3<f64>; 6] {
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

    /// Adjoint of [`Gripper::points`]: adds the gradient with respect to the gripper to `gradient`.
    pub fn points_back(&self, upstream: [Vector3<f64>; 2], gradient: &mut Self) {
        let [_, by_yaw, by_pitch, yaw_yaw, yaw_pitch, pitch_pitch] = self.gradients();
        let [t, rate] = upstream;
        gradient.angles.x += by_yaw.dot(&t) + (yaw_yaw * self.rates.x + yaw_pitch * self.rates.y).dot(&rate);
        gradient.angles.y += by_pitch.dot(&t) + (yaw_pitch * self.rates.x + pitch_pitch * self.rates.y).dot(&rate);
        gradient.rates.x += by_yaw.dot(&rate);
        gradient.rates.y += by_pitch.dot(&rate);
    }
}

impl Chain {
    /// The gripper's motion in a frame under its drives alone, in closed form. `torques` (N, N m) act on its six axes.
    /// With `e` the coordinate minus its rest position `torque / stiffness`, `v` its rate and `w` the natural frequency
    /// (rad/s), `e' = (e + (v + w e) dt) exp(-w dt)`, `v' = (v - w (v + w e) dt) exp(-w dt)`.
    pub fn glide(&self, gripper: &Gripper, torques: &[f64]) -> Gripper {
        let mut next = *gripper;
        for (k, torque) in torques.iter().enumerate().take(6) {
            let home = if k < 3 { self.home[k] } else { 0.0 };
            let [x, v] = axis(&mut next, k);
            let goal = torque / self.stiffness[k] + home;
            let w = self.pulse[k];
            let e = *x - goal;
            let fade = (-w * self.frame_time).exp();
            let pull = *v + w * e;
            *x = goal + (e + pull * self.frame_time) * fade;
            *v = (*v - w * pull * self.frame_time) * fade;
        }
        next
    }

    /// Adjoint of [`Chain::glide`], a linear map. Gives the gradient with respect to the gripper before the frame, from
    /// that with respect to the gripper after it.
    pub fn glide_back(&self, upstream: &Gripper) -> Gripper {
        let mut gradient = *upstream;
        for k in 0..6 {
            let w = self.pulse[k];
            let dt = self.frame_time;
            let [x, v] = axis(&mut gradient, k);
            let fade = (-w * dt).exp();
            (*x, *v) = ((*x * (1.0 + w * dt) - *v * w * w * dt) * fade, (*x * dt + *v * (1.0 - w * dt)) * fade);
        }
        gradient
    }
}

/// Coordinate and rate of the gripper's axis k.
fn axis(gripper: &mut Gripper, k: usize) -> [&mut f64; 2] {
    let Gripper { at, velocity, angles, rates } = gripper;
    if k < 3 { [&mut at[k], &mut velocity[k]] } else { [&mut angles[k - 3], &mut rates[k - 3]] }
}
