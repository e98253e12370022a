//! The solver as a program for a device: the text of its kernels, with one robot's sizes and tables before them.
//!
//! The text is CUDA C++ for NVRTC. Any C++ compiler accepts it too, as a program that steps a batch from its standard input, so the
//! kernels are tested without a GPU.

use std::fmt::Write;

use nerd_core::dynamics::Factor;

use super::super::energy::{FALL, FINEST, LABOUR, SHARE, WHIRL, WHIRL_RK4};
use super::super::implicit::{CALM, HALVINGS};
use super::super::kick::{LOST as FAR_OFF, OFF, PASSES, SETTLED};
use super::super::stiff::{Bounds, MOST, MOST_DRAG, MOST_RK4, POWERS};
use super::super::touch::{CREEP, EVEN};
use super::{super::along, super::fold::FOLLOWED};
use crate::prelude::*;
use crate::system::capsules::{BARREL, Capsule};

const KERNELS: [&str; 13] = [
    include_str!("linear.cuh"),
    include_str!("surface.cuh"),
    include_str!("walk.cuh"),
    include_str!("tree.cuh"),
    include_str!("locus.cuh"),
    include_str!("slopes.cuh"),
    include_str!("along.cuh"),
    include_str!("touch.cuh"),
    include_str!("fold.cuh"),
    include_str!("implicit.cuh"),
    include_str!("explicit.cuh"),
    include_str!("energy.cuh"),
    include_str!("frame.cuh"),
];
const ALONE: &str = include_str!("alone.cuh");

/// Numbers of a collider in a scene's record.
const COLLIDER: usize = 20;
/// The most steps of a factorisation that are written one by one into the text.
const WALKS: usize = 4000;
/// What a frame says beyond `1 + DoF` of a mass matrix that is none: a distance that is not a number, a state that is none.
const LOST: i32 = 1 << 20;
const GONE: i32 = LOST + 1;
/// What its way back says beside: more substeps than are kept.
const FINER: i32 = GONE + 1;

/// Precision of the kernels; states are f64 in both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Real {
    /// 32 bits, positions from the root on.
    #[default]
    F32,
    /// 64 bits, for comparison with the CPU's solver.
    F64,
}

/// What a program supports beyond its robot and settings; it is compiled again for more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reach {
    /// Colliders of a scene at most.
    pub colliders: usize,
    /// Whether there are drives.
    pub driven: bool,
}

impl Reach {
    /// What a batch asks for.
    pub fn of(batch: &Batch) -> Self {
        let colliders = batch.scenes.iter().map(|s| s.colliders.len()).max().unwrap_or(0);
        Self { colliders, driven: !batch.drives.is_empty() }
    }
}

/// Vectors in 64 bits, the surfaces of a scene with so many colliders, and the numbers of faults: what needs no robot.
pub fn surfaces(colliders: usize) -> String {
    let sizes = format!("#define REAL double\n#define NC {colliders}\n#define LOST {LOST}\n#define GONE {GONE}\n");
    sizes + KERNELS[0] + KERNELS[1]
}

/// The text for one robot: the kernel `advance`.
pub fn program(system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
    functions(system, config, real, reach) + ALONE
}

/// The same without a kernel: what one is made of.
pub fn functions(system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
    let robot = &system.robot;
    let mut text = String::new();
    let bounds = Bounds::new(system);
    let mut define = |name: &str, value: String| {
        let _ = writeln!(text, "#define {name} {value}");
    };
    let count = |n: usize| n.to_string();
    define("REAL", if real == Real::F64 { "double" } else { "float" }.into());
    let sizes = [("NL", robot.links.len()), ("NV", robot.nv()), ("NQ", robot.nq()), ("NJ", robot.joint_count())];
    let more = [("DOFS", robot.root_dofs()), ("COORDS", robot.root_coords()), ("NP", robot.contact_points.len()), ("NC", reach.colliders)];
    sizes.into_iter().chain(more).for_each(|(name, n)| define(name, count(n)));
    define("UNROLLED", flag(walks(robot) <= WALKS && !along(robot)));
    define("PRESSED", count(robot.joints().map(|j| usize::from(j.friction > 0.0) + 2 * usize::from(j.limit.is_some())).sum()));
    define("SUBSTEPS", count(config.substeps));
    define("CONTACT_SUBSTEPS", count(config.contact_substeps));
    define("RK4", flag(config.integrator == Integrator::Rk4));
    define("IMPLICIT", flag(config.contact_step == ContactStep::Implicit));
    define("RENEW", flag(config.refresh == Refresh::Substep));
    define("HUBER", flag(config.friction == Friction::Huber));
    define("HELD", flag(system.held()));
    define("ALONG", flag(deep(system)));
    define("HALVINGS", count(HALVINGS));
    let watched = config.contact_step == ContactStep::Implicit && system.stand_ins.is_empty() && system.folds.is_empty();
    define("WATCHED", flag(watched));
    define("FINEST", count(FINEST));
    define("DRIVEN", flag(reach.driven));
    define("LOCI", flag(robot.contact_points.iter().any(|p| p.locus != Locus::Fixed)));
    define("FOLDS", count(system.folds.pairs.len()));
    define("PASSES", count(PASSES));
    let constants = [("SETTLED", SETTLED), ("CREEP", CREEP), ("MOST_EULER", MOST), ("MOST_RK4", MOST_RK4), ("MOST_DRAG", MOST_DRAG)];
    let more =
        [("CALM", CALM), ("OFF", OFF), ("FAR_OFF", FAR_OFF), ("STIFFEST", FOLLOWED[0]), ("FOLLOWED", FOLLOWED[1]), ("BARREL", BARREL)];
    let energy = [("EVEN", EVEN), ("SHARE", SHARE), ("LABOUR", LABOUR), ("FALL", FALL), ("WHIRL", WHIRL), ("WHIRL_RK4", WHIRL_RK4)];
    constants.into_iter().chain(more).chain(energy).for_each(|(name, x)| define(name, format!("((real){})", number(x))));
    define("POWERS", count(POWERS));
    define("LOST", LOST.to_string());
    define("GONE", GONE.to_string());
    define("FINER", FINER.to_string());
    define("FRAME", format!("{:e}", system.frame_time));
    define("DAMPED", format!("((real){})", number(bounds.damped)));
    text.push_str(KERNELS[0]);
    links(&mut text, system);
    joints(&mut text, robot, &bounds);
    points(&mut text, robot);
    folds(&mut text, system, &bounds);
    KERNELS[1..].iter().for_each(|part| text.push_str(part));
    text
}

/// Whether implicit steps go along the tree.
pub(super) fn deep(system: &System) -> bool {
    along(&system.robot) && system.stand_ins.is_empty() && !system.robot.mimics()
}

/// What a factorisation of the mass matrix takes: for each DoF, the square of how many are above it and itself.
fn walks(robot: &Robot) -> usize {
    let mut depths: Vec<usize> = Vec::new();
    for above in Factor::new(robot).above() {
        depths.push(1 + above.map_or(0, |k| depths[k]));
    }
    depths.iter().map(|d| d * d).sum()
}

fn links(text: &mut String, system: &System) {
    let robot = &system.robot;
    let (dofs, first) = (robot.dofs(), robot.root_dofs());
    let of = |f: &dyn Fn(usize) -> i64| -> Vec<i64> { (0..robot.links.len()).map(f).collect() };
    let joint = |i: usize| robot.links[i].joint.as_ref();
    let parents = of(&|i| robot.links[i].parent.map_or(-1, |p| p as i64));
    whole(text, "PARENT", parents);
    whole(text, "DOF", of(&|i| dofs[i] as i64));
    whole(text, "JOINT", of(&|i| dofs[i].saturating_sub(first) as i64));
    whole(text, "SLIDES", of(&|i| i64::from(joint(i).is_some_and(|j| j.kind == JointKind::Prismatic))));
    whole(text, "MASS_OF", of(&|i| system.stand_ins.get(i).map_or(i as i64, |o| *o as i64)));
    whole(text, "ABOVE", Factor::new(robot).above().map(|p| p.map_or(-1, |p| p as i64)).collect());
    let numbers = |f: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> { (0..robot.links.len()).flat_map(f).collect() };
    real_table(text, "RATIO", numbers(&|i| vec![joint(i).map_or(1.0, |j| j.ratio())]));
    real_table(text, "OFFSET", numbers(&|i| vec![joint(i).and_then(|j| j.mimic()).map_or(0.0, |m| m.offset)]));
    real_table(text, "ARMATURE", numbers(&|i| vec![joint(i).map_or(0.0, |j| j.ratio().powi(2) * j.armature)]));
    real_table(text, "PLACE", numbers(&|i| joint(i).map_or(vec![0.0; 3], |j| j.origin().translation.vector.as_slice().to_vec())));
    real_table(text, "AXIS", numbers(&|i| joint(i).map_or(vec![0.0; 3], |j| j.axis().as_slice().to_vec())));
    let rows = |m: &nalgebra::Matrix3<f64>| m.transpose().as_slice().to_vec();
    real_table(text, "TURN", numbers(&|i| joint(i).map_or(vec![0.0; 27], |j| j.turn().iter().flat_map(rows).collect())));
    real_table(text, "MASS", numbers(&|i| vec![robot.links[i].inertia.mass]));
    real_table(text, "COM", numbers(&|i| robot.links[i].inertia.com.as_slice().to_vec()));
    real_table(text, "BODY", numbers(&|i| rows(&robot.links[i].inertia.inertia)));
    let (turned, place) = match robot.base {
        Base::Fixed(pose) => (rows(&pose.rotation.to_rotation_matrix().into_inner()), pose.translation.vector.as_slice().to_vec()),
        Base::Floating => (vec![0.0; 9], vec![0.0; 3]),
    };
    real_table(text, "BASE", turned);
    table(text, "double", "STAND", place.iter().map(|x| number(*x)));
}

fn joints(text: &mut String, robot: &Robot, bounds: &Bounds) {
    real_table(text, "DAMPING", robot.joints().map(|j| j.damping).collect());
    real_table(text, "SPRING", robot.joints().map(|j| j.stiffness).collect());
    real_table(text, "SLACK", robot.joints().map(|j| j.rest).collect());
    real_table(text, "DRY", robot.joints().map(|j| j.friction).collect());
    real_table(text, "TOP", robot.joints().map(|j| j.velocity).collect());
    real_table(
        text,
        "LIMIT",
        robot.joints().flat_map(|j| j.limit.map_or([0.0; 4], |l| [l.lower, l.upper, l.stiffness, l.damping])).collect(),
    );
    whole(text, "LIMITED", robot.joints().map(|j| i64::from(j.limit.is_some())).collect());
    whole(text, "WRAPS", robot.joints().map(|j| i64::from(j.wraps())).collect());
    real_table(text, "LEAST", bounds.least.clone());
    real_table(text, "EASE", bounds.ease.clone());
}

fn points(text: &mut String, robot: &Robot) {
    let points = &robot.contact_points;
    whole(text, "POINT_LINK", points.iter().map(|p| p.link as i64).collect());
    real_table(text, "POINT", points.iter().flat_map(|p| p.local.as_slice().to_vec()).collect());
    real_table(text, "RADIUS", points.iter().map(|p| p.radius).collect());
    real_table(text, "REACH", points.iter().map(|p| p.reach()).collect());
    let (mut kinds, mut rims, mut hulls, mut all) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for point in points {
        let (mut kind, mut rim, first) = (0, [0.0; 6], all.len() / 3);
        match &point.locus {
            Locus::Fixed => {}
            Locus::Rim { axis, radius, turn } => (kind, rim) = (1, [axis.x, axis.y, axis.z, *radius, turn.sin(), turn.cos()]),
            Locus::Hull { vertices, .. } => {
                kind = 2;
                all.extend(vertices.iter().flat_map(|v| v.as_slice().to_vec()));
            }
        }
        kinds.push(kind);
        rims.extend(rim);
        hulls.extend([first as i64, (all.len() / 3) as i64]);
    }
    whole(text, "LOCUS", kinds);
    real_table(text, "RIM", rims);
    whole(text, "HULL", hulls);
    real_table(text, "VERTEX", all);
}

pub(super) fn whole(text: &mut String, name: &str, numbers: Vec<i64>) {
    table(text, "int", name, numbers.into_iter().map(|n| n.to_string()));
}

fn real_table(text: &mut String, name: &str, numbers: Vec<f64>) {
    table(text, "real", name, numbers.into_iter().map(|x| format!("(real){}", number(x))));
}

/// A switch.
pub(super) fn flag(on: bool) -> String {
    i32::from(on).to_string()
}

fn folds(text: &mut String, system: &System, bounds: &Bounds) {
    let (folds, m) = (&system.folds, &system.spec.material);
    whole(text, "FOLD_LINKS", folds.pairs.iter().flatten().map(|link| *link as i64).collect());
    whole(text, "FOLD_OWN", folds.own.iter().flat_map(|own| [own.start as i64, own.end as i64]).collect());
    real_table(text, "FOLD_EASE", bounds.folds.clone());
    real_table(text, "FOLD_BALL", folds.balls.iter().flat_map(|(c, reach)| [c.x, c.y, c.z, *reach]).collect());
    let numbers = |c: &Capsule| [c.middle.as_slice(), c.half.as_slice(), &[c.radius]].concat();
    real_table(text, "CAPSULE", folds.capsules.iter().flat_map(numbers).collect());
    real_table(text, "FOLD_MATERIAL", vec![m.stiffness, m.damping, m.friction_damping, m.friction]);
}

/// What is infinite is more than any number of a frame, and fits into an f32.
pub(super) fn number(x: f64) -> String {
    format!("{:e}", x.clamp(-1e38, 1e38))
}

/// An array with at least one entry, since none may have none.
pub(super) fn table(text: &mut String, kind: &str, name: &str, entries: impl Iterator<Item = String>) {
    let mut entries: Vec<String> = entries.collect();
    if entries.is_empty() {
        entries.push("0".into());
    }
    let _ = writeln!(text, "TABLE {kind} {name}[] = {{{}}};", entries.join(", "));
}

/// A scene's record: gravity, then its colliders, each with its kind, geometry and the material that it makes with the robot.
///
/// # Errors
/// A shape without a kernel; for explicit steps, anything but one plane.
pub fn record(scene: &Scene, system: &System, config: &ArticulatedConfig, reach: Reach) -> Result<Vec<f64>, String> {
    let held = system.held() || reach.driven;
    let implicit = config.contact_step == ContactStep::Implicit || held;
    let mut numbers = scene.gravity.as_slice().to_vec();
    for (k, body) in scene.colliders.iter().enumerate() {
        let mut own = [0.0; COLLIDER];
        let stand = |own: &mut [f64]| {
            own[1..10].copy_from_slice(body.pose.rotation.to_rotation_matrix().matrix().transpose().as_slice());
            own[10..13].copy_from_slice(body.pose.translation.vector.as_slice());
        };
        if let Some(plane) = &body.plane {
            own[0] = 1.0;
            own[1..4].copy_from_slice(plane.normal.as_slice());
            own[4] = plane.offset;
        } else if let Some(cuboid) = body.shape.as_cuboid() {
            own[0] = 2.0;
            stand(&mut own);
            own[13..16].copy_from_slice(&[cuboid.half_extents.x, cuboid.half_extents.y, cuboid.half_extents.z]);
        } else if let Some(peg) = body.shape.as_cylinder() {
            own[0] = 3.0;
            stand(&mut own);
            own[13..15].copy_from_slice(&[peg.radius, peg.half_height]);
        } else {
            return Err(format!(
                "scene `{}`, collider {k}: on a device there are planes, boxes and pegs alone; step it on the CPU",
                scene.name
            ));
        }
        let material = body.material.mean(&system.spec.material);
        own[16..].copy_from_slice(&[material.stiffness, material.damping, material.friction_damping, material.friction]);
        numbers.extend(own);
    }
    if !implicit && (scene.colliders.len() > 1 || scene.colliders.iter().any(|c| c.plane.is_none())) {
        return Err(format!("scene `{}`: on a device explicit steps know one plane alone; take an implicit preset", scene.name));
    }
    numbers.resize(3 + COLLIDER * reach.colliders, 0.0);
    Ok(numbers)
}

/// What a fault's number means.
pub fn fault(robot: &Robot, code: i32) -> String {
    match code {
        LOST => "a contact point's distance is not a number: the state or the collider is not finite".into(),
        FINER => "the frame's energy asks for more substeps than are kept for its slopes: take them on the CPU, or more substeps".into(),
        GONE => "the state after the frame is not a number; the state before it is the last good one".into(),
        code => Factor::new(robot).fault_at(robot, Some(code as usize - 1)),
    }
}

/// What the kernels take for drives: five numbers each.
pub fn packed(drives: &[Drive]) -> Vec<f64> {
    drives.iter().flat_map(|d| [d.kp, d.kd, d.target, d.speed, d.effort.min(1e30)]).collect()
}
