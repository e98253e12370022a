//! Static geometry: everything that is not the robot, held once as parry shapes, so that every solver, the learned
//! one too, sees the same thing. A plane is answered in closed form; it is never queried as a mesh.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use nerd_core::contact::ContactEvent;
use parry3d_f64::math::{Pose, Rotation, Vector as ParryVector};
use parry3d_f64::shape::SharedShape;
use serde::{Deserialize, Serialize};

/// Compliant contact material; a pair acts with the mean of its two.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Normal stiffness k_e (N/m).
    pub stiffness: f64,
    /// Normal damping k_d (N s/m), while approaching.
    pub damping: f64,
    /// Tangential damping k_f (N s/m).
    pub friction_damping: f64,
    /// Friction coefficient mu.
    pub friction: f64,
}

impl Default for Material {
    /// The reference simulator's plane: 1e5 N/m, 1e3 N s/m, 1e3 N s/m, 0.5.
    fn default() -> Self {
        Self { stiffness: 1e5, damping: 1e3, friction_damping: 1e3, friction: 0.5 }
    }
}

impl Material {
    /// Material of a pair.
    pub fn mean(&self, other: &Self) -> Self {
        let mean = |a: f64, b: f64| 0.5 * (a + b);
        Self {
            stiffness: mean(self.stiffness, other.stiffness),
            damping: mean(self.damping, other.damping),
            friction_damping: mean(self.friction_damping, other.friction_damping),
            friction: mean(self.friction, other.friction),
        }
    }
}

/// The half-space `normal . x <= offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, pointing out.
    pub normal: Vector3<f64>,
    /// Distance of the surface from the world's origin along the normal (m).
    pub offset: f64,
}

/// One static body.
#[derive(Clone)]
pub struct Collider {
    /// Its shape.
    pub shape: SharedShape,
    /// Its pose in the world.
    pub pose: Isometry3<f64>,
    /// Its material.
    pub material: Material,
    /// Set if the shape is a half-space, which is then answered in closed form.
    pub plane: Option<Plane>,
}

impl Collider {
    /// A plane.
    pub fn plane(plane: Plane, material: Material) -> Self {
        let pose = Isometry3::translation(plane.normal.x * plane.offset, plane.normal.y * plane.offset, plane.normal.z * plane.offset);
        Self { shape: SharedShape::halfspace(to_parry(&plane.normal)), pose, material, plane: Some(plane) }
    }

    /// Any other parry shape.
    pub fn new(shape: SharedShape, pose: Isometry3<f64>, material: Material) -> Self {
        let plane = shape.as_halfspace().map(|h| {
            let normal = pose.rotation * from_parry(&h.normal);
            Plane { normal, offset: normal.dot(&pose.translation.vector) }
        });
        Self { shape, pose, material, plane }
    }

    /// Nearest point and outward normal of the surface for the world point `p0`.
    #[inline]
    fn query(&self, p0: &Vector3<f64>) -> ContactEvent {
        if let Some(plane) = &self.plane {
            let distance = plane.normal.dot(p0) - plane.offset;
            return ContactEvent { p0: *p0, p1: p0 - plane.normal * distance, normal: plane.normal, distance, collider: 0 };
        }
        let found = self.shape.project_point(&pose_to_parry(&self.pose), to_parry(p0), false);
        let p1 = from_parry(&found.point);
        let (gap, sign) = (p0 - p1, if found.is_inside { -1.0 } else { 1.0 });
        let length = gap.norm();
        let normal = if length > 1e-12 { gap * (sign / length) } else { Vector3::zeros() };
        ContactEvent { p0: *p0, p1, normal, distance: sign * length, collider: 0 }
    }
}

/// Gravity and static colliders.
#[derive(Clone)]
pub struct Scene {
    /// Name, as on the command line.
    pub name: String,
    /// Gravity (m/s^2), world axes.
    pub gravity: Vector3<f64>,
    /// Static bodies.
    pub colliders: Vec<Collider>,
}

impl Scene {
    /// Nothing but gravity.
    pub fn free(gravity: Vector3<f64>) -> Self {
        Self { name: "free".into(), gravity, colliders: Vec::new() }
    }

    /// The nearest collider's event for the world point `p0`.
    #[inline]
    pub fn contact(&self, p0: &Vector3<f64>) -> ContactEvent {
        let mut best = ContactEvent::none(*p0);
        for (collider, body) in self.colliders.iter().enumerate() {
            let event = body.query(p0);
            if event.distance < best.distance {
                best = ContactEvent { collider, ..event };
            }
        }
        best
    }
}

/// nalgebra to parry.
pub(crate) fn to_parry(v: &Vector3<f64>) -> ParryVector {
    ParryVector::new(v.x, v.y, v.z)
}

/// parry to nalgebra.
pub(crate) fn from_parry(v: &ParryVector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// nalgebra to parry.
pub(crate) fn pose_to_parry(pose: &Isometry3<f64>) -> Pose {
    let q: &Quaternion<f64> = pose.rotation.quaternion();
    Pose::from_parts(to_parry(&pose.translation.vector), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}

/// parry to nalgebra.
#[cfg(feature = "rapier")]
pub(crate) fn pose_from_parry(pose: &Pose) -> Isometry3<f64> {
    let (t, r) = (from_parry(&pose.translation), pose.rotation);
    Isometry3::from_parts(t.into(), UnitQuaternion::new_normalize(Quaternion::new(r.w, r.x, r.y, r.z)))
}

/// The up direction, against gravity, and the horizontal plane turned by extrinsic x-y-z angles.
pub(crate) fn turned_plane(gravity: &Vector3<f64>, height: f64, angles: [f64; 3]) -> Plane {
    let up = -gravity.normalize();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angles[2])
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angles[1])
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angles[0]);
    let normal = turn * up;
    Plane { normal, offset: normal.dot(&(up * height)) }
}
