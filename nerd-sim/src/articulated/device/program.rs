//! CUDA text of the solver: the kernels, preceded by the sizes and tables of one robot.
//!
//! The text is CUDA C++ for NVRTC. Any C++ compiler accepts it too, so the kernels are tested without a GPU.

use nalgebra::Point3;
use nerd_core::dynamics::Factor;

use super::super::along::{along, chained};
use super::super::energy::{
    FALL_TOLERANCE, FAST_TURN_RK4, GAIN_TOLERANCE, GAIN_TOLERANCE_FREE, MAX_REFINED, MAX_REFINED_TERRAIN,
    WORK_TOLERANCE,
};
use super::super::fold::{MAX_FOLD_DAMPING, MAX_FOLD_STIFFNESS};
use super::super::implicit::{MAX_HALVINGS, MAX_SPRING_DAMPING};
use super::super::kick::{LOST as FAR_OFF, OFF, PASSES, SETTLED};
use super::super::spin::{FAST_ROOT, MAX_ROOT_TURN_RK4, SPIN_PASSES, SPIN_TOLERANCE};
use super::super::stick::{
    AT_REST, BREAKAWAY, BREAKAWAY_SOLVES, CREEPS, HELD_FACTOR, MIN_INV_MASS, STICK_DRAG, SUBSTEPS_AT_REST,
};
use super::super::stiff::{MAX_RADIUS, MAX_RADIUS_RK4, POWER_STEPS};
use super::super::touch::{CREEP, MEAN_THETA};
use super::super::turning::{MIN_GYRATION, TURN_INERTIA, TURN_STICK_DRAG};
use super::own::{Own, lifts};
use super::tables::tables;
use super::text::{Text, number};
use crate::prelude::*;
use crate::robots::motors::{LATEST, WAVES};
use crate::system::capsules::BARREL;

/// Constants with their names.
macro_rules! named {
    ($($constant:ident),*) => { [$((stringify!($constant), $constant)),*] };
}

const KERNELS: [&str; 15] = [
    include_str!("linear.cuh"),
    include_str!("surface.cuh"),
    include_str!("walk.cuh"),
    include_str!("tree.cuh"),
    include_str!("locus.cuh"),
    include_str!("gradients.cuh"),
    include_str!("along.cuh"),
    include_str!("touch.cuh"),
    include_str!("fold.cuh"),
    include_str!("press.cuh"),
    include_str!("spin.cuh"),
    include_str!("implicit.cuh"),
    include_str!("explicit.cuh"),
    include_str!("energy.cuh"),
    include_str!("frame.cuh"),
];
const ALONE: [&str; 2] = [include_str!("rig.cuh"), include_str!("alone.cuh")];

/// How many numbers a scene's record has for a material, and for a collider with its material.
const MATERIAL: usize = 8;
pub(super) const COLLIDER: usize = 16 + MATERIAL;
/// Largest number of factorisation steps that the text writes out one by one.
const MAX_UNROLLED_STEPS: usize = 4000;
/// Fault codes, larger than those of a mass matrix that is not positive definite (`1 + DoF`). `LOST`: a distance is
/// NaN. `GONE`: the state is not finite.
const LOST: i32 = 1 << 20;
const GONE: i32 = LOST + 1;

/// Precision of the kernels; states are f64 in both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Real {
    /// 32 bits, with positions relative to the root.
    #[default]
    F32,
    /// 64 bits, for comparison with the CPU solver.
    F64,
}

/// Features that a program supports beyond its robot and settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reach {
    /// Largest number of colliders in a scene.
    pub colliders: usize,
    /// Whether there are drives.
    pub driven: bool,
    /// Whether the drives belong to servos.
    pub servo: bool,
    /// Whether there are height fields.
    pub fields: bool,
    /// Whether there are balls, capsules or convex hulls.
    pub hulls: bool,
    /// Whether materials depend on contact point and collider, by surfaces of the robot's file.
    pub paired: bool,
    /// Whether there is torsional or rolling friction.
    pub turns: bool,
    /// Parameters that differ between robots.
    pub own: Own,
}

impl Reach {
    /// Features that a batch needs.
    pub fn of(batch: &Batch) -> Self {
        let colliders = batch.scenes.iter().map(|s| s.colliders.len()).max().unwrap_or(0);
        let fields = batch.scenes.iter().any(|s| s.uneven());
        let hulls = batch.scenes.iter().any(|s| s.colliders.iter().any(|c| capsule(c).is_some() || c.hull.is_some()));
        let paired = !batch.system.surfaces.is_empty();
        let turning = |m: &Material| m.torsion > 0.0 || m.rolling > 0.0;
        let robots = std::iter::once(&batch.system).chain(&batch.systems);
        let bodies = batch.scenes.iter().flat_map(|scene| &scene.colliders);
        let turns = batch.system.surfaces.turns()
            || robots.map(|robot| &robot.spec.material).any(turning)
            || bodies.map(|body| &body.material).any(turning);
        Self {
            colliders,
            driven: batch.servo || !batch.drives.is_empty(),
            servo: batch.servo,
            fields,
            hulls,
            paired,
            turns,
            own: Own::of(batch),
        }
    }
}

/// Text without a robot: vectors in 64 bits, surfaces of a scene with at most this many colliders, fault codes.
pub fn surfaces(colliders: usize) -> Text {
    let sizes = format!(
        "#define REAL double\n#define FIELDS 0\n#define HULLS 0\n#define PAIRED 0\n#define NC {colliders}\n#define LOST {LOST}\n#define GONE {GONE}\n"
    );
    Text(sizes + KERNELS[0] + KERNELS[1])
}

/// CUDA text of the kernel `advance` for one robot.
pub fn program(system: &System, config: &ArticulatedConfig, real: Real, reach: Reach) -> String {
    let mut text = functions(system, config, real, reach, true);
    if reach.own.rigged() {
        text.define([("LATEST", LATEST), ("WAVES", WAVES)]);
    }
    text.0 + &ALONE.concat()
}

/// CUDA text of the functions without a kernel: with `steps` those that step frames, otherwise those of the code around
/// the steps.
pub fn functions(system: &System, config: &ArticulatedConfig, real: Real, reach: Reach, steps: bool) -> Text {
    let robot = &system.robot;
    let mut text = Text::default();
    text.define([("REAL", if real == Real::F64 { "double" } else { "float" })]);
    sizes(&mut text, system, config, reach);
    flags(&mut text, system, reach, steps);
    constants(&mut text);
    text.define([("ROOT_DAMPING", number(robot.free.damping)), ("FRAME", format!("{:e}", system.frame_time))]);
    text.0 += KERNELS[0];
    tables(&mut text, system);
    reach.own.write(&mut text, system, true);
    if steps && (reach.servo || reach.own.rigged()) {
        reach.own.write(&mut text, system, false);
    }
    if steps && reach.servo {
        text.table("double", "TORQUE_LIMIT", (0..robot.joint_count()).map(|i| system.torque_limit(i).min(1e30)));
    }
    text.0 += &KERNELS[1..].concat();
    text
}

/// Numbers of links, coordinates, substeps and solves.
fn sizes(text: &mut Text, system: &System, config: &ArticulatedConfig, reach: Reach) {
    let robot = &system.robot;
    text.define([
        ("NL", robot.links.len()),
        ("NV", robot.nv()),
        ("NQ", robot.nq()),
        ("NJ", robot.joint_count()),
        ("DOFS", robot.root_dofs()),
        ("COORDS", robot.root_coords()),
        ("NP", robot.contact_points.len()),
        ("NC", reach.colliders),
        (
            "PRESSED",
            robot
                .joints()
                .map(|j| usize::from(j.friction > 0.0 || reach.own.dry()) + 2 * usize::from(j.limit.is_some()))
                .sum(),
        ),
        ("SUBSTEPS", config.substeps),
        ("CONTACT_SUBSTEPS", config.contact_substeps),
        ("MAX_HALVINGS", MAX_HALVINGS),
        ("MAX_REFINED", MAX_REFINED),
        ("MAX_REFINED_TERRAIN", MAX_REFINED_TERRAIN),
        ("FOLDS", system.folds.pairs.len()),
        ("PASSES", PASSES),
        ("BREAKAWAY_SOLVES", BREAKAWAY_SOLVES),
        ("SUBSTEPS_AT_REST", SUBSTEPS_AT_REST),
        ("SPIN_PASSES", SPIN_PASSES),
        ("POWER_STEPS", POWER_STEPS),
    ]);
}

/// Features, each 0 or 1.
fn flags(text: &mut Text, system: &System, reach: Reach, steps: bool) {
    let robot = &system.robot;
    let stable_pd = !reach.servo && system.spec.control.as_ref().is_some_and(|c| c.stable_pd);
    let flags = [
        // Code around the steps may use loops, which compile in a fraction of the time. A stable PD law runs in every
        // frame and is unrolled.
        ("UNROLLED", walks(robot) <= MAX_UNROLLED_STEPS && !deep(system) && (steps || stable_pd || !whips(system))),
        ("MATRIX", !steps && stable_pd),
        ("HELD", reach.own.held(system)),
        ("ALONG", deep(system)),
        ("WHIPS", whips(system)),
        ("WATCHED", system.stand_ins.is_empty()),
        ("DRIVEN", reach.driven),
        ("SERVO", steps && reach.servo),
        ("FIELDS", reach.fields),
        ("HULLS", reach.hulls),
        ("PAIRED", reach.paired),
        ("TURNS", reach.turns),
        ("LIFTS", lifts(robot)),
        ("CENTRED", robot.floating() && (robot.links[0].inertia.com != Vector3::zeros() || reach.own.centred())),
        ("FREED", robot.free.damping != 0.0),
        ("RIGGED", reach.own.rigged()),
        ("LOCI", robot.contact_points.iter().any(|p| p.locus != Locus::Fixed)),
    ];
    text.define(flags.map(|(name, on)| (name, i32::from(on))));
}

/// Constants of the solver, and fault codes.
fn constants(text: &mut Text) {
    let constants = named! {
        SETTLED, CREEP, MAX_RADIUS, MAX_RADIUS_RK4, STICK_DRAG, HELD_FACTOR, MIN_INV_MASS, BREAKAWAY, TURN_STICK_DRAG,
        CREEPS, AT_REST, TURN_INERTIA, MIN_GYRATION, MAX_SPRING_DAMPING, MAX_FOLD_STIFFNESS, MAX_FOLD_DAMPING, OFF,
        FAR_OFF, MEAN_THETA, GAIN_TOLERANCE, GAIN_TOLERANCE_FREE, WORK_TOLERANCE, FALL_TOLERANCE, FAST_TURN_RK4,
        FAST_ROOT, SPIN_TOLERANCE, MAX_ROOT_TURN_RK4, BARREL
    };
    text.define(constants.map(|(name, x)| (name, format!("((real){})", number(x)))));
    text.define([("LOST", LOST), ("GONE", GONE)]);
}

/// Whether implicit steps watch for chains that whip.
pub(super) fn whips(system: &System) -> bool {
    along(&system.robot) && system.stand_ins.is_empty() && !system.robot.mimics()
}

/// Whether implicit steps solve along the tree, as on the CPU. A robot that is no chain, with a factorisation short
/// enough to write out, uses the matrix: that is faster for a G1.
fn deep(system: &System) -> bool {
    whips(system) && (chained(&system.robot) || walks(&system.robot) > MAX_UNROLLED_STEPS)
}

/// Cost of factorising the mass matrix: the sum over DoFs of the squared number of DoFs from each one to the root.
fn walks(robot: &Robot) -> usize {
    let mut depths: Vec<usize> = Vec::new();
    for above in Factor::new(robot).above() {
        depths.push(1 + above.map_or(0, |k| depths[k]));
    }
    depths.iter().map(|d| d * d).sum()
}

/// Record of a scene: gravity, then kind, geometry and material (combined with the robot's) of each collider. With
/// [`Reach::paired`] the material of each contact point on each collider follows; in a family, the parameters of
/// `system`, the environment's robot.
///
/// # Errors
/// A shape without a kernel.
pub fn record(scene: &Scene, system: &System, reach: Reach) -> Result<Vec<f64>, String> {
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
        } else if let Some(field) = body.field.as_ref().filter(|_| reach.fields) {
            own[0] = 4.0;
            stand(&mut own);
            own[13] = field.scale();
        } else if let Some([radius, half]) = capsule(body).filter(|_| reach.hulls) {
            own[0] = 5.0;
            stand(&mut own);
            own[13..15].copy_from_slice(&[radius, half]);
        } else if body.hull.is_some() && reach.hulls {
            own[0] = 6.0;
            stand(&mut own);
            // Centre of the bounding ball.
            own[10..13].copy_from_slice((body.pose * Point3::from(body.ball.0)).coords.as_slice());
            own[13] = body.ball.1;
        } else {
            return Err(format!(
                "scene `{}`, collider {k}: on a device there are planes, boxes, pegs, capsules and hulls alone; step it on the CPU",
                scene.name
            ));
        }
        own[16..].copy_from_slice(&of(&body.material.mean(&system.spec.material)));
        numbers.extend(own);
    }
    numbers.resize(3 + COLLIDER * reach.colliders, 0.0);
    for point in system.robot.contact_points.iter().filter(|_| reach.paired) {
        let meetings = scene.colliders.iter().map(|body| system.meeting(point, body).map_or(NO_MEETING, |m| of(&m)));
        numbers.extend(meetings.chain(std::iter::repeat(NO_MEETING)).take(reach.colliders).flatten());
    }
    numbers.extend(reach.own.numbers(system)?);
    Ok(numbers)
}

/// Radius and half the length of a capsule about z, or of a ball.
fn capsule(body: &Collider) -> Option<[f64; 2]> {
    if let Some(ball) = body.shape.as_ball() {
        return Some([ball.radius, 0.0]);
    }
    let capsule = body.shape.as_capsule()?;
    let (a, b) = (capsule.segment.a, capsule.segment.b);
    ([a.x, a.y, b.x, b.y] == [0.0; 4] && a.z == -b.z).then(|| [capsule.radius, b.z.abs()])
}

/// Material of a point and a collider that never meet.
const NO_MEETING: [f64; MATERIAL] = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

fn of(m: &Material) -> [f64; MATERIAL] {
    [m.stiffness, m.damping, m.friction_damping, m.friction, m.torsion, m.rolling, m.margin, m.release]
}

/// Refuses settings of the reference simulator, which have no kernels and are used by no training and no task.
///
/// # Errors
/// Symplectic Euler, explicit contact and Huber's friction.
pub fn has_kernels(config: &ArticulatedConfig) -> Result<(), StepError> {
    match (config.integrator, config.contact_step, config.friction) {
        (Integrator::Rk4, ContactStep::Implicit, Friction::Coulomb) => Ok(()),
        _ => Err(StepError::Refused(
            "preset paper (robots NAME-paper), symplectic Euler and Huber's friction have no kernels: step on the CPU, or by preset accurate".into(),
        )),
    }
}

/// Message for a fault code.
pub fn fault(robot: &Robot, code: i32) -> String {
    match code {
        LOST => "a contact point's distance is not a number: the state or the collider is not finite".into(),
        GONE => "the state after the frame is not a number; the state before it is the last good one".into(),
        code => Factor::new(robot).fault_at(robot, Some(code as usize - 1)),
    }
}

/// Drives as the kernels read them: kp, kd, target, speed and effort of each.
pub fn packed(drives: &[Drive]) -> Vec<f64> {
    drives.iter().flat_map(|d| [d.kp, d.kd, d.target, d.speed, d.effort.min(1e30)]).collect()
}
