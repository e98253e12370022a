//! Scenes that every robot with contact points has besides its own: a plane, a slope, a box, steps, hills.
//!
//! The scenes are laid out with z up, then rotated so that z is the robot's up axis. Nothing rises above the ground
//! within 0.4 m of the origin. A start clear of a plane is therefore clear in every scene.

use std::sync::LazyLock;

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::shape::{SharedShape, TriMesh, TriMeshFlags};

use super::spec::{PegSpec, PlaneSpec, SceneSpec};
use super::{Field, up};
use crate::internal::*;

/// Names of the scenes that every robot with contact points has.
pub const WORLDS: [&str; 5] = ["plane", "slope", "box", "steps", "hills"];

/// Inclination of `slope` (rad): 10 degrees, rising along x, through the origin.
const SLOPE: f64 = 0.174_532_925_199_432_95;
/// Box of `box` on a plane: half edges and centre (m).
const BOX: [[f64; 3]; 2] = [[0.3, 0.5, 0.1], [0.75, 0.0, 0.1]];
/// Steps of `steps`: number, rise, tread, width (m). The first step begins at x = 0.4 m.
const STEPS: (usize, f64, f64, f64) = (6, 0.08, 0.4, 4.0);
/// Hills of `hills`: half side (m), cells per side, depth of the deepest valley (m). Beyond the hills lies a plane at
/// this depth.
const HILLS: (f64, usize, f64) = (16.0, 128, 0.3);

/// The mesh of `hills`, made once and shared by all scenes.
static HILLS_MESH: LazyLock<Option<SharedShape>> = LazyLock::new(|| hills().map(SharedShape::new));

/// A scene from a robot's TOML; `material` is used if the TOML gives the scene no material.
pub(crate) fn described(spec: &SceneSpec, gravity: &Vector3<f64>, material: Material) -> Result<Scene, String> {
    let upright = upright(gravity);
    let stated = spec.material.is_some();
    let material = spec.material.unwrap_or(material);
    let ground = match &spec.terrain {
        Some(terrain) => {
            let pose = Isometry3::from_parts((up(gravity) * spec.plane.height).into(), upright);
            Collider::terrain(Field::drawn(terrain)?, pose, material)
        }
        None => Collider::plane(flat(gravity, &spec.plane), material),
    };
    let boxes = spec.boxes.iter().map(|b| {
        let [x, y, z] = b.size.map(|edge| 0.5 * edge);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), b.yaw);
        Collider::new(
            SharedShape::cuboid(x, y, z),
            Isometry3::from_parts(Vector3::from(b.position).into(), upright * turn),
            material,
        )
    });
    let pegs = spec.pegs.iter().map(|p| peg(p, gravity, material));
    let colliders =
        std::iter::once(ground).chain(boxes).chain(pegs).map(|collider| Collider { stated, ..collider }).collect();
    Ok(Scene { name: spec.name.clone(), gravity: *gravity, colliders })
}

/// The horizontal plane rotated by extrinsic x-y-z angles.
pub(crate) fn flat(gravity: &Vector3<f64>, PlaneSpec { height, angles }: &PlaneSpec) -> Plane {
    let up = up(gravity);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angles[2])
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angles[1])
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angles[0]);
    let normal = turn * up;
    Plane { normal, offset: normal.dot(&(up * *height)) }
}

pub(crate) fn peg(spec: &PegSpec, gravity: &Vector3<f64>, material: Material) -> Collider {
    // Parry's cylinders lie along y.
    let standing = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let middle = Vector3::from(spec.position) + up(gravity) * (0.5 * spec.height);
    let pose = Isometry3::from_parts(middle.into(), upright(gravity) * standing);
    Collider::new(SharedShape::cylinder(0.5 * spec.height, spec.radius), pose, material)
}

/// Rotation from z to the up direction.
fn upright(gravity: &Vector3<f64>) -> UnitQuaternion<f64> {
    rotation_from(&Vector3::z_axis(), &up(gravity))
}

/// A scene of [`WORLDS`] under `gravity`, with one material.
pub fn world(name: &str, gravity: &Vector3<f64>, material: Material) -> Option<Scene> {
    let turn = upright(gravity);
    let level =
        |height: f64, normal: Vector3<f64>| Collider::plane(Plane { normal: turn * normal, offset: height }, material);
    let cuboid = |half: [f64; 3], centre: [f64; 3]| {
        let pose = Isometry3::from_parts((turn * Vector3::from(centre)).into(), turn);
        Collider::new(SharedShape::cuboid(half[0], half[1], half[2]), pose, material)
    };
    let ground = level(0.0, Vector3::z());
    let colliders = match name {
        "plane" => vec![ground],
        "slope" => vec![level(0.0, Vector3::new(-SLOPE.sin(), 0.0, SLOPE.cos()))],
        "box" => vec![ground, cuboid(BOX[0], BOX[1])],
        "steps" => {
            let (count, rise, tread, width) = STEPS;
            // Each step is a box on the ground that extends to the end of the last step.
            let step = |k: usize| {
                let from = 0.4 + tread * k as f64;
                let to = 0.4 + tread * count as f64;
                let height = rise * (k + 1) as f64;
                cuboid([0.5 * (to - from), 0.5 * width, 0.5 * height], [0.5 * (from + to), 0.0, 0.5 * height])
            };
            std::iter::once(ground).chain((0..count).map(step)).collect()
        }
        "hills" => {
            let pose = Isometry3::from_parts(Vector3::zeros().into(), turn);
            vec![level(-HILLS.2, Vector3::z()), Collider::new(HILLS_MESH.clone()?, pose, material)]
        }
        _ => return None,
    };
    Some(Scene { name: name.into(), gravity: *gravity, colliders })
}

/// Height (m) of the hills above (x, y), between the negative depth and 0: a fixed sum of waves.
pub fn hill(x: f64, y: f64) -> f64 {
    let wave = |a: f64, b: f64, c: f64| 0.5 * (a * x + b * y + c).sin();
    let sum = wave(1.3, 0.4, 1.1) * wave(-0.3, 1.1, 0.2) * 2.0 + 0.7 * wave(2.1, -1.7, 2.0) + 0.3 * wave(3.7, 3.1, 0.5);
    HILLS.2 * (sum - 1.0).clamp(-2.0, 0.0) / 2.0
}

/// The hills as an oriented mesh, solid below: a parry height field has no inside, so a point below it would be lost.
fn hills() -> Option<TriMesh> {
    let (half, cells, _) = HILLS;
    let at = |k: usize| -half + 2.0 * half * k as f64 / cells as f64;
    let corner = |i: usize, j: usize| (i * (cells + 1) + j) as u32;
    let grid = |n: usize| (0..n).flat_map(move |i| (0..n).map(move |j| (i, j)));
    let vertices = grid(cells + 1).map(|(i, j)| ParryVector::new(at(i), at(j), hill(at(i), at(j)))).collect();
    let faces = grid(cells).flat_map(|(i, j)| {
        let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
        [[a, b, c], [a, c, d]]
    });
    TriMesh::with_flags(vertices, faces.collect(), TriMeshFlags::ORIENTED).ok()
}
