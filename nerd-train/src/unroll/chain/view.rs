//! Augmentation: motions mirrored, and turned about the vertical axis through the gripper's home.

use super::*;

/// A view of a motion: y mirrored or not, then turned by the angle yaw (rad).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub(super) yaw: f64,
    /// Factor on y: 1, or -1 if mirrored.
    pub(super) mirror: f64,
    pub(super) sin: f64,
    pub(super) cos: f64,
}

impl View {
    /// A view that mirrors y if `mirrored`, then turns by `yaw` (rad).
    pub fn new(yaw: f64, mirrored: bool) -> Self {
        let (sin, cos) = yaw.sin_cos();
        Self { yaw, mirror: if mirrored { -1.0 } else { 1.0 }, sin, cos }
    }

    /// Transforms a direction or velocity to the view.
    pub fn vector(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let y = v.y * self.mirror;
        Vector3::new(self.cos * v.x - self.sin * y, self.sin * v.x + self.cos * y, v.z)
    }

    fn back(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.cos * v.x + self.sin * v.y, self.mirror * (self.cos * v.y - self.sin * v.x), v.z)
    }

    /// Transforms the state of a chain to the view.
    pub fn rods(&self, chain: &Chain, rods: &Rods) -> Rods {
        let Gripper { at, velocity, angles, rates } = &rods.gripper;
        let turn = |v: &Vector3<f64>| Vector3::new(v.x * self.mirror, v.y, v.z * self.mirror);
        let gripper = Gripper {
            at: chain.home + self.vector(&(at - chain.home)),
            velocity: self.vector(velocity),
            angles: turn(angles) + Vector3::x() * self.yaw,
            rates: turn(rates),
        };
        let vectors = |all: &[Vector3<f64>]| all.iter().map(|v| self.vector(v)).collect();
        Rods { gripper, along: vectors(&rods.along), rates: vectors(&rods.rates) }
    }

    /// Transforms the gripper's torques (N, N m) to the view. The neutral angle of the gripper's yaw spring turns too.
    pub fn torques(&self, chain: &Chain, torques: &[f64]) -> [f64; 6] {
        let force = self.vector(&Vector3::new(torques[0], torques[1], torques[2]));
        let yaw = torques[3] * self.mirror + chain.stiffness[3] * self.yaw;
        [force.x, force.y, force.z, yaw, torques[4], torques[5] * self.mirror]
    }

    /// The nearest surface at the position `place` of the view, with the surface's normal in the view.
    pub fn contact(&self, chain: &Chain, scene: &Scene, place: &Vector3<f64>) -> ContactEvent {
        let event = scene.contact(&(chain.home + self.back(&(place - chain.home))));
        ContactEvent { normal: self.vector(&event.normal), ..event }
    }
}
