//! Static objects in the world of a robot's file, and stiffness and damping of the robot's contacts.

use nerd_core::robot::Form;
use parry3d_f64::shape::SharedShape;

use super::derive::vertices;
use super::mesh::hull::corners;
use super::mjcf::{Description, Static};
use crate::internal::*;
use crate::scene::{PairLaw, Softness, Surfaces, to_parry, up};

/// Static objects in the world of a file, and contact laws of its geoms.
#[derive(Clone, Debug, Default)]
pub(crate) struct World {
    pub colliders: Vec<Collider>,
    pub surfaces: Surfaces,
}

/// Height above the lowest contact point, as a share of the robot's extent, up to which contact points carry weight.
const MAX_CARRYING_HEIGHT: f64 = 0.02;

impl World {
    /// The world of a file at `path`; an unreadable mesh is left out, with a note.
    pub fn of(file: &Description, path: Option<&Path>, notes: &mut Vec<String>) -> Self {
        let material = Material::default();
        let mut colliders = Vec::new();
        for own in &file.world {
            match own {
                Static::Plane { plane, surface } => {
                    colliders.push(Collider { surface: *surface, ..Collider::plane(*plane, material) })
                }
                Static::Field { field, pose, surface } => {
                    colliders.push(Collider { surface: *surface, ..Collider::terrain(field.clone(), *pose, material) });
                }
                Static::Solid(solid) => {
                    let hull = |vertices: &[Vector3<f64>]| {
                        let places: Vec<_> = corners(vertices).iter().map(to_parry).collect();
                        let shape = std::panic::catch_unwind(|| SharedShape::convex_hull(&places)).ok().flatten();
                        shape
                            .map(|shape| Collider::new(shape, solid.pose, material))
                            .ok_or_else(|| "it has no convex hull".to_string())
                    };
                    let made = match &solid.form {
                        Form::Shape(kind) => {
                            let shape = Shape { pose: solid.pose, kind: *kind, surface: None };
                            Ok(Collider::shaped(&shape, &Isometry3::identity(), material))
                        }
                        Form::Hull(vertices) => hull(vertices),
                        Form::Mesh { file, scale } => {
                            path.ok_or("no file is known".into()).and_then(|path| hull(&vertices(file, scale, path)?))
                        }
                    };
                    match made {
                        Ok(collider) => colliders.push(Collider { surface: solid.surface, ..collider }),
                        Err(reason) => notes.push(format!("a geom of the world touches nothing: {reason}")),
                    }
                }
            }
        }
        Self { colliders, surfaces: file.surfaces.clone() }
    }
}

/// Sets stiffness and damping of a robot's contacts from its file, as multiples of the values of `material`. A contact
/// point that carries its share of the weight at `state` then has the same penetration as in MuJoCo.
pub(crate) fn soften(
    surfaces: &mut Surfaces,
    robot: &Robot,
    state: &[f64],
    gravity: &Vector3<f64>,
    material: &Material,
) -> Result<(), String> {
    if surfaces.is_empty() || robot.contact_points.is_empty() || gravity.norm() == 0.0 {
        return Ok(());
    }
    let weights = inverse_weights(robot)?;
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let up = up(gravity);
    let heights: Vec<f64> = robot.contact_points.iter().map(|p| crate::scene::foot(p, &data, &up)).collect();
    let [low, high] = heights.iter().fold([f64::MAX, f64::MIN], |[low, high], x| [low.min(*x), high.max(*x)]);
    let bearing = heights.iter().filter(|x| **x <= low + MAX_CARRYING_HEIGHT * (high - low)).count().max(1);
    let load = robot.mass() * gravity.norm() / bearing as f64;
    let body =
        |surface: usize| robot.contact_points.iter().find(|p| p.surface == Some(surface)).map(|p| weights[p.link]);
    let [elliptic, impratio, step] = [f64::from(surfaces.elliptic), surfaces.impratio, surfaces.step];
    surfaces.each(|a, b, law| {
        let inverse: f64 = [Some(a), b].into_iter().flatten().filter_map(body).sum();
        if inverse > 0.0 {
            let [stiffness, damping] =
                at_load(&law.softness, inverse * pyramid(law, elliptic > 0.0, impratio), load, step);
            law.factors = [stiffness / material.stiffness, damping / material.damping];
            law.release = if stiffness > 0.0 { (damping / stiffness).min(1.0) } else { 0.0 };
        }
    });
    Ok(())
}

/// Softening by MuJoCo's pyramidal friction cone, as a factor on the inverse inertia of a contact.
fn pyramid(law: &PairLaw, elliptic: bool, impratio: f64) -> f64 {
    let square = law.friction.max(1e-5).powi(2);
    if elliptic || law.condim == 1 { 1.0 } else { square * (1.0 + square) / ((law.condim - 1) as f64 * impratio) }
}

/// Stiffness (N/m) and damping (N s/m) of a contact with inverse inertia A = `inverse` (1/kg), at rest under a load
/// (N).
///
/// At penetration r (m) and closing velocity v (m/s), MuJoCo's contact has the impedance d(r) and the force
/// `(b v + k d r) d / ((1 - d) A)`.
fn at_load(softness: &Softness, inverse: f64, load: f64, step: f64) -> [f64; 2] {
    let [d0, wide, width, middle, power] = softness.solimp;
    let bound = |x: f64| x.clamp(1e-4, 0.9999);
    let d0 = bound(d0);
    let wide = bound(wide);
    let middle = bound(middle);
    let power = power.max(1.0);
    let impedance = |depth: f64| {
        let x = if width > 1e-15 { (depth / width).min(1.0) } else { 1.0 };
        let y = match x {
            x if power == 1.0 => x,
            x if x <= middle => x.powf(power) / middle.powf(power - 1.0),
            x => 1.0 - (1.0 - x).powf(power) / (1.0 - middle).powf(power - 1.0),
        };
        d0 + y * (wide - d0)
    };
    let [first, second] = softness.solref;
    let (k, b) = if first > 0.0 {
        let time = first.max(2.0 * step);
        (1.0 / (wide * time * second.max(1e-9)).powi(2), 2.0 / (wide * time))
    } else {
        (-first / (wide * wide), -second / wide)
    };
    let share = |depth: f64| impedance(depth) / ((1.0 - impedance(depth)) * inverse);
    let stiffness = |depth: f64| k * impedance(depth) * share(depth);
    // Penetration under the load, by bisection: the force increases with penetration.
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let depth = 0.5 * (low + high);
        if stiffness(depth) * depth < load { low = depth } else { high = depth }
    }
    [stiffness(high), b * share(high)]
}

/// For each link, its inverse effective mass (1/kg) at its centre of mass and zero coordinates: `J M^-1 J^T`, averaged
/// over directions.
pub(crate) fn inverse_weights(robot: &Robot) -> Result<Vec<f64>, String> {
    let mut data = Data::new(robot);
    let mut factor = Factor::new(robot);
    let state = robot.zero_state();
    kinematics(robot, &state[..robot.nq()], &mut data);
    crba(robot, &mut data);
    if !factor.refill(&data.mass) {
        return Err(factor.fault(robot));
    }
    let of = |link: usize| {
        let pose = Isometry3::from_parts(robot.links[link].inertia.com.into(), UnitQuaternion::identity());
        let frame = FixedFrame { name: String::new(), link: Some(link), pose };
        let rows = data
            .jacobian(robot, &state[..robot.nq()], &frame, nerd_core::dynamics::Axes::World)
            .fixed_rows::<3>(3)
            .transpose();
        let weight = rows.column_iter().map(|row| {
            let mut x: Vec<f64> = row.iter().copied().collect();
            factor.solve(&mut x);
            x.iter().zip(row.iter()).map(|(a, b)| a * b).sum::<f64>() / 3.0
        });
        weight.sum()
    };
    Ok((0..robot.links.len()).map(of).collect())
}
