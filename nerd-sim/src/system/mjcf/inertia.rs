//! Shapes and inertias of bodies, by the rules of MuJoCo's compiler.

use std::f64::consts::PI;

use mjcf_rs::body::{Geom, GeomType, InertiaSpec};
use mjcf_rs::{Model, Pose, body::Body, compiler::InertiaFromGeom};

use crate::internal::*;

pub(super) fn isometry(pose: &Pose) -> Isometry3<f64> {
    let (p, q) = (pose.translation, pose.rotation);
    let turn = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
    Isometry3::from_parts(Vector3::new(p.x, p.y, p.z).into(), turn)
}

/// The rotation that takes z to a direction, the shortest.
pub(super) fn upright(z: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::z(), z)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), if z.z < 0.0 { PI } else { 0.0 }))
}

/// Where a geom is on its body, and its sizes (m): half the length along z last, of what is given by its ends.
pub(super) fn placed(geom: &Geom) -> (Isometry3<f64>, Vector3<f64>) {
    let size = Vector3::from(geom.size);
    let Some([a, b, c, x, y, z]) = geom.fromto else { return (isometry(&geom.pose), size) };
    let (from, to) = (Vector3::new(a, b, c), Vector3::new(x, y, z));
    let (pose, half) = (Isometry3::from_parts((0.5 * (from + to)).into(), upright(&(from - to))), 0.5 * (from - to).norm());
    let long = matches!(geom.type_, GeomType::Capsule | GeomType::Cylinder);
    (pose, if long { Vector3::new(size.x, half, 0.0) } else { Vector3::new(size.x, size.x, half) })
}

/// The shape of a geom, `None` of what is no primitive of ours.
pub(super) fn shape(geom: &Geom) -> Option<ShapeKind> {
    let size = placed(geom).1;
    let (radius, half_length) = (size.x, size.y);
    Some(match geom.type_ {
        GeomType::Sphere => ShapeKind::Sphere { radius },
        GeomType::Capsule => ShapeKind::Capsule { radius, half_length },
        GeomType::Cylinder => ShapeKind::Cylinder { radius, half_length },
        GeomType::Box => ShapeKind::Box { half: size },
        _ => return None,
    })
}

/// Volume (m^3) and principal moments at a mass of 1 kg (m^2) of a geom with sizes.
fn moments(kind: GeomType, size: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let (r, h) = (size.x, 2.0 * size.y);
    let round = |across: f64, along: f64| Vector3::new(across, across, along);
    Some(match kind {
        GeomType::Sphere => (4.0 / 3.0 * PI * r.powi(3), Vector3::repeat(0.4 * r * r)),
        GeomType::Cylinder => (PI * r * r * h, round((3.0 * r * r + h * h) / 12.0, 0.5 * r * r)),
        GeomType::Capsule => {
            let ends = 4.0 * r / (4.0 * r + 3.0 * h);
            let across = (1.0 - ends) * (3.0 * r * r + h * h) / 12.0 + ends * (0.4 * r * r + 0.25 * h * h + 0.375 * h * r);
            (PI * r * r * (h + 4.0 / 3.0 * r), round(across, (1.0 - ends) * 0.5 * r * r + ends * 0.4 * r * r))
        }
        GeomType::Box | GeomType::Ellipsoid => {
            let (volume, share) = if kind == GeomType::Box { (8.0, 1.0 / 3.0) } else { (4.0 / 3.0 * PI, 0.2) };
            let s = size.component_mul(size);
            (volume * size.product(), Vector3::new(s.y + s.z, s.x + s.z, s.x + s.y) * share)
        }
        _ => return None,
    })
}

/// A body's inertia in its own frame, and what is wrong with it.
pub(super) fn of(body: &Body, model: &Model) -> Result<BodyInertia, String> {
    let compiler = &model.compiler;
    let own = body.inertial.as_ref().filter(|_| compiler.inertia_from_geom != InertiaFromGeom::True);
    let mut sum = BodyInertia::default();
    let mut add = |pose: &Isometry3<f64>, mass: f64, inertia: Matrix3<f64>| {
        let part = BodyInertia { mass, com: Vector3::zeros(), inertia };
        sum = sum.welded(&part.transformed(&pose.rotation.to_rotation_matrix(), &pose.translation.vector));
    };
    match own {
        Some(own) => {
            let inertia = match own.inertia {
                InertiaSpec::Diagonal(d) => Matrix3::from_diagonal(&d.into()),
                InertiaSpec::Full([xx, yy, zz, xy, xz, yz]) => Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            };
            add(&isometry(&own.pose), own.mass, inertia);
        }
        None if compiler.inertia_from_geom == InertiaFromGeom::False => {}
        None => {
            for geom in &body.geoms {
                let (pose, size) = placed(geom);
                let none = geom.mass.or(geom.density) == Some(0.0);
                match moments(geom.type_, &size).filter(|_| geom.mesh.is_none()) {
                    _ if none || geom.type_ == GeomType::Plane => {}
                    Some((volume, unit)) => {
                        let mass = geom.mass.unwrap_or_else(|| geom.density.unwrap_or(compiler.inertia_density) * volume);
                        add(&pose, mass, Matrix3::from_diagonal(&(unit * mass)));
                    }
                    None => return Err("its mass would be that of a mesh or a field; give it an <inertial>".into()),
                }
            }
        }
    }
    sum.mass = sum.mass.max(compiler.bound_mass);
    let principal = sum.inertia.symmetric_eigen();
    let mut d = principal.eigenvalues;
    let broken = 2.0 * d.max() > d.sum() + 1e-10 * d.max().max(1e-300) && compiler.balance_inertia;
    if compiler.bound_inertia > 0.0 || broken {
        d = d.map(|x| x.max(compiler.bound_inertia));
        let balanced = 2.0 * d.max() > d.sum() && compiler.balance_inertia;
        d = if balanced { Vector3::repeat(d.mean()) } else { d };
        sum.inertia = principal.eigenvectors * Matrix3::from_diagonal(&d) * principal.eigenvectors.transpose();
    }
    Ok(sum)
}
