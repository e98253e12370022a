//! Converts points and poses to and from parry's types.

use nalgebra::Quaternion;
use parry3d_f64::math::{Pose, Rotation, Vector as ParryVector};

use crate::internal::*;

pub(crate) fn to_parry(v: &Vector3<f64>) -> ParryVector {
    ParryVector::new(v.x, v.y, v.z)
}

pub(crate) fn from_parry(v: &ParryVector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

pub(crate) fn pose_to_parry(pose: &Isometry3<f64>) -> Pose {
    let q: &Quaternion<f64> = pose.rotation.quaternion();
    Pose::from_parts(to_parry(&pose.translation.vector), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}

#[cfg(feature = "rapier")]
pub(crate) fn pose_from_parry(pose: &Pose) -> Isometry3<f64> {
    let t = from_parry(&pose.translation);
    let r = pose.rotation;
    Isometry3::from_parts(t.into(), nalgebra::UnitQuaternion::new_normalize(Quaternion::new(r.w, r.x, r.y, r.z)))
}
