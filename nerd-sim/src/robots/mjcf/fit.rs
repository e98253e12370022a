//! Fits primitives to meshes: sizes and poses by the rules of MuJoCo's compiler.

use nalgebra::Rotation3;

use super::geom::{Geom, Type};
use super::model::{Mesh, Model};
use crate::internal::*;

/// Sets size and pose of every primitive that names a mesh.
pub(super) fn fit(model: &mut Model) -> Result<(), UrdfError> {
    let Model { bodies, meshes, .. } = model;
    for body in bodies {
        let fitted = |geom: &&mut Geom| {
            geom.mesh.is_some() && ![Type::Mesh, Type::Sdf, Type::Plane, Type::HeightField].contains(&geom.kind)
        };
        for geom in body.geoms.iter_mut().filter(fitted) {
            let name = geom.mesh.take().unwrap_or_default();
            let mesh = meshes.iter().find(|mesh| mesh.name == name);
            let mesh = mesh.ok_or_else(|| {
                body.element.refused(format!("there is no mesh `{}` among the assets", name.escape_debug()))
            })?;
            let (pose, half) =
                bounds(mesh, body.source.compiler.around).map_err(|reason| body.element.refused(reason))?;
            geom.pose *= pose;
            geom.size = sizes(geom.kind, &half, body.source.compiler.around).map(|x| x * geom.fit);
        }
    }
    Ok(())
}

/// Pose and half edges (m) of a box along the principal axes of a mesh, in order of falling moment of inertia. It is
/// the box of equal inertia, or with `around` the bounding box.
fn bounds(mesh: &Mesh, around: bool) -> Result<(Isometry3<f64>, Vector3<f64>), String> {
    let own = mesh.weighed()?;
    let principal = own.inertia.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| principal.eigenvalues[*b].total_cmp(&principal.eigenvalues[*a]));
    let moments = Vector3::from(order.map(|k| principal.eigenvalues[k]));
    let [first, second] = [0, 1].map(|k| principal.eigenvectors.column(order[k]).into_owned());
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[first, second, first.cross(&second)]));
    let pose = Isometry3::from_parts(own.com.into(), UnitQuaternion::from_rotation_matrix(&axes));
    if !around {
        return Ok((pose, moments.map(|x| (1.5 * (moments.sum() - 2.0 * x) / own.mass).max(0.0).sqrt())));
    }
    let seen = mesh.triangles()?.0.into_iter().map(|v| pose.inverse_transform_point(&v.into()).coords);
    let (low, high) =
        seen.fold((Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN)), |(low, high), v| (low.inf(&v), high.sup(&v)));
    Ok((pose * Isometry3::from(0.5 * (low + high)), 0.5 * (high - low)))
}

/// MuJoCo's size numbers (m) of a primitive fitted to a box with half edges `half` (m).
fn sizes(kind: Type, half: &Vector3<f64>, around: bool) -> [f64; 3] {
    let [x, y, z] = [half.x, half.y, half.z];
    let across = if around { x.max(y) } else { 0.5 * (x + y) };
    match (kind, around) {
        (Type::Sphere, true) => [x.max(y).max(z), 0.0, 0.0],
        (Type::Sphere, false) => [(x + y + z) / 3.0, 0.0, 0.0],
        (Type::Capsule, true) => [across, (z - across).max(0.0), 0.0],
        (Type::Capsule, false) => [across, (z - 0.5 * across).max(0.0), 0.0],
        (Type::Cylinder, _) => [across, z, 0.0],
        _ => [x, y, z],
    }
}
