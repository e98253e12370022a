//! Contact quantities `c = (p0, p1, n, d)` of the paper (A.1) and the mask over them.
//!
//! Contacts are found by geometry: a fixed list of points on the robot, each tested against the scene once a frame.
//! `d = n . (p0 - p1)` is measured from the point itself (the centre of a sphere or of a capsule's end, a place on a
//! cylinder's rim), so the surfaces touch at `d = radius`.

use nalgebra::Vector3;

/// A point fixed on a link at which contact is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactPoint {
    /// Index of the link.
    pub link: usize,
    /// Position in the link frame (m).
    pub local: Vector3<f64>,
    /// Radius of the surface around it (m) in the contact law.
    pub radius: f64,
    /// Contact thickness (m), which sets the mask.
    pub thickness: f64,
}

impl ContactPoint {
    /// Distance beyond which a contact is masked, `xi = max(4 thickness, 0.1)` m (paper A.1).
    pub fn threshold(&self) -> f64 {
        (4.0 * self.thickness).max(0.1)
    }
}

/// What the collision query says of one contact point; positions and normal in world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactEvent {
    /// The point on the robot (m).
    pub p0: Vector3<f64>,
    /// The nearest point of the scene (m).
    pub p1: Vector3<f64>,
    /// Unit normal of the scene's surface at `p1`, pointing out of it.
    pub normal: Vector3<f64>,
    /// Signed distance `n . (p0 - p1)` (m), negative inside; infinite in an empty scene.
    pub distance: f64,
    /// Index of the collider in its scene.
    pub collider: usize,
}

impl ContactEvent {
    /// No scene within reach.
    pub fn none(p0: Vector3<f64>) -> Self {
        Self { p0, p1: Vector3::zeros(), normal: Vector3::zeros(), distance: f64::INFINITY, collider: 0 }
    }

    /// The event, or a zero one if it lies beyond the point's threshold.
    pub fn masked(&self, point: &ContactPoint) -> Self {
        if self.distance < point.threshold() { *self } else { Self::default() }
    }
}
