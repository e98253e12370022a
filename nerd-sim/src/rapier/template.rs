//! A robot as rapier's bodies: built once, never stepped, copied into a fresh world in every frame.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;
use rapier3d_f64::prelude::*;

use super::pairs::{TURNS, of_file, turns};
use crate::internal::*;
use crate::scene::{self, pose_to_parry, to_parry};

/// Collision groups: the robot collides with the scene, but not with itself.
const ROBOT: InteractionGroups = InteractionGroups::new(Group::GROUP_1, Group::GROUP_2, InteractionTestMode::And);
const SCENE: InteractionGroups = InteractionGroups::new(Group::GROUP_2, Group::GROUP_1, InteractionTestMode::And);

/// Bodies, colliders and joints of a robot at zero coordinates.
pub(super) struct Template {
    pub(super) bodies: RigidBodySet,
    pub(super) colliders: ColliderSet,
    pub(super) joints: MultibodyJointSet,
    pub(super) links: Vec<RigidBodyHandle>,
    /// The multibody; `None` for a single free body. Link 0 of the multibody is the base or the floating root. The
    /// multibody's DoFs are in the order of `qd`, except that a root's linear DoFs come first.
    pub(super) multibody: Option<MultibodyIndex>,
    /// Centre of mass of a floating root in its link frame (m), used as the origin of the root's rapier body. rapier
    /// moves the origin of a free root with the velocity of its centre of mass.
    pub(super) root_com: Vector3<f64>,
}

impl Template {
    pub(super) fn new(system: &System) -> Result<Self, String> {
        let robot = &system.robot;
        expressible(system)?;
        let mut bodies = RigidBodySet::new();
        let mut colliders = ColliderSet::new();
        let mut joints = MultibodyJointSet::new();
        let root_com = if robot.floating() { robot.links[0].inertia.com } else { Vector3::zeros() };
        let base = match robot.base {
            Base::Fixed(pose) => Some(bodies.insert(RigidBodyBuilder::fixed().pose(pose_to_parry(&pose)))),
            Base::Floating => None,
        };
        let mut links = Vec::with_capacity(robot.links.len());
        for (i, link) in robot.links.iter().enumerate() {
            let shift = shift(robot, i, &root_com);
            let body = RigidBodyBuilder::dynamic()
                .can_sleep(false)
                .additional_mass_properties(mass_properties(&link.inertia, &shift));
            let handle = bodies.insert(body);
            for (builder, geom) in touching(robot, i, &shift) {
                let builder = surface(builder.density(0.0), &system.spec.material, ROBOT);
                colliders.insert_with_parent(of_file(system, builder, geom), handle, &mut bodies);
            }
            if let Some(joint) = &link.joint {
                let parent = link
                    .parent
                    .map(|p| links[p])
                    .or(base)
                    .ok_or_else(|| format!("link `{}` hangs on nothing", link.name))?;
                let frames = frames(joint, &link.parent.map_or(Vector3::zeros(), |p| self::shift(robot, p, &root_com)));
                joints
                    .insert(parent, handle, frames, false)
                    .ok_or_else(|| format!("rapier refuses joint `{}`", joint.name))?;
            }
            links.push(handle);
        }
        let handles: Vec<_> = bodies.iter().map(|(handle, _)| handle).collect();
        for handle in handles {
            if let Some(body) = bodies.get_mut(handle) {
                // Without this call, rapier's masses are zero until after the first step.
                body.recompute_mass_properties_from_colliders(&colliders);
            }
        }
        let multibody = links.last().and_then(|last| joints.rigid_body_link(*last)).map(|l| l.multibody);
        if let Some(multibody) = multibody.and_then(|index| joints.get_multibody_mut(index)) {
            equip(multibody, &bodies, robot)?;
        }
        Ok(Self { bodies, colliders, joints, links, multibody, root_com })
    }
}

/// Refuses robots that rapier's multibodies cannot express.
fn expressible(system: &System) -> Result<(), String> {
    let robot = &system.robot;
    if let Some(joint) = robot.follower() {
        return Err(format!("joint `{}` follows another (<mimic>), which rapier's multibodies cannot", joint.name));
    }
    if let Some(joint) = robot.joints().find(|j| j.friction > 0.0) {
        return Err(format!("joint `{}` has dry friction, which rapier's multibodies have not", joint.name));
    }
    if robot.free.damping != 0.0 || robot.links.iter().any(|link| link.lifted.mass != 0.0) {
        return Err(
            "its file takes weight off links, or damps its free root, which rapier's multibodies cannot; step with articulated".into(),
        );
    }
    if !system.folds.is_empty() {
        return Err(
            "self_collision is on, and here a robot touches the scene alone; leave it out, or step with articulated"
                .into(),
        );
    }
    if system.surfaces.turns() || turns(&system.spec.material) {
        return Err(TURNS.into());
    }
    Ok(())
}

/// Gives a multibody its joints' damping and armature.
fn equip(multibody: &mut Multibody, bodies: &RigidBodySet, robot: &Robot) -> Result<(), String> {
    // A fixed root has six DoFs until this call reads the type of its body.
    multibody.forward_kinematics(bodies, true);
    if multibody.ndofs() != robot.nv() {
        return Err(format!("rapier gives the robot {} degrees of freedom, it has {}", multibody.ndofs(), robot.nv()));
    }
    // rapier damps every angular DoF by 0.1, including a free root's.
    multibody.damping_mut().fill(0.0);
    for (i, joint) in robot.joints().enumerate() {
        multibody.damping_mut()[robot.root_dofs() + i] = joint.damping;
        multibody.armature_mut()[robot.root_dofs() + i] = joint.armature;
    }
    Ok(())
}

/// Colliders of a link against the scene, each with its surface number in the robot's file.
fn touching(robot: &Robot, link: usize, shift: &Vector3<f64>) -> Vec<(ColliderBuilder, Option<usize>)> {
    let (shapes, points) = robot.touching(link);
    let shapes = shapes.into_iter().filter_map(|shape| {
        let pose = Isometry3::translation(-shift.x, -shift.y, -shift.z) * shape.pose;
        let (builder, pose) = match shape.kind {
            ShapeKind::Box { half } => (ColliderBuilder::cuboid(half.x, half.y, half.z), pose),
            // rapier's cylinders lie along y.
            ShapeKind::Cylinder { radius, half_length } => {
                let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
                (ColliderBuilder::cylinder(half_length, radius), pose * turn)
            }
            _ => return None,
        };
        Some((builder.position(pose_to_parry(&pose)), shape.surface))
    });
    let balls = points.iter().flat_map(|p| p.places().into_iter().map(move |at| (at, p.radius, p.surface)));
    let ball = |(at, radius, surface)| (ColliderBuilder::ball(radius).translation(to_parry(&(at - shift))), surface);
    shapes.chain(balls.map(ball)).collect()
}

/// Adds a scene's colliders to a world that is rotated about its origin by `turn`. The restitution of a pair is the
/// larger one, which is the scene's.
pub(super) fn insert_scene(scene: &Scene, turn: &UnitQuaternion<f64>, restitution: f64, colliders: &mut ColliderSet) {
    for (k, body) in scene.colliders.iter().enumerate() {
        let scene::Collider { shape, pose, material, .. } = body;
        let builder = ColliderBuilder::new(shape.clone()).position(pose_to_parry(&(turn * pose)));
        let builder = surface(builder, material, SCENE).restitution(restitution).user_data(k as u128);
        colliders.insert(builder.restitution_combine_rule(CoefficientCombineRule::Max));
    }
}

/// Index of a joint's free axis among rapier's six: linear x or angular x.
pub(super) fn axis(joint: &Joint) -> usize {
    if joint.kind == JointKind::Prismatic { 0 } else { 3 }
}

/// Sets friction (mean of a pair), zero restitution, and half of the pair's margin.
fn surface(builder: ColliderBuilder, material: &Material, groups: InteractionGroups) -> ColliderBuilder {
    builder
        .contact_skin((0.5 * material.margin).max(0.0))
        .friction(material.friction)
        .friction_combine_rule(CoefficientCombineRule::Average)
        .restitution(0.0)
        .restitution_combine_rule(CoefficientCombineRule::Average)
        .collision_groups(groups)
}

/// Origin of a link's rapier body in the link frame.
fn shift(robot: &Robot, link: usize, root_com: &Vector3<f64>) -> Vector3<f64> {
    if robot.floating() && link == 0 { *root_com } else { Vector3::zeros() }
}

fn mass_properties(inertia: &BodyInertia, shift: &Vector3<f64>) -> MassProperties {
    let i = &inertia.inertia;
    let column = |k: usize| Vector::new(i[(0, k)], i[(1, k)], i[(2, k)]);
    MassProperties::with_inertia_matrix(
        to_parry(&(inertia.com - shift)),
        inertia.mass,
        Matrix::from_cols(column(0), column(1), column(2)),
    )
}

/// A joint along or about the x axis of two frames; `parent` is the origin of the parent's rapier body in its link
/// frame.
fn frames(joint: &Joint, parent: &Vector3<f64>) -> GenericJoint {
    let align = Isometry3::from_parts(Vector3::zeros().into(), rotation_from(&Vector3::x_axis(), joint.axis()));
    let first = Isometry3::translation(-parent.x, -parent.y, -parent.z) * joint.origin() * align;
    let locked = if joint.kind == JointKind::Prismatic {
        JointAxesMask::LOCKED_PRISMATIC_AXES
    } else {
        JointAxesMask::LOCKED_REVOLUTE_AXES
    };
    let builder = GenericJointBuilder::new(locked).contacts_enabled(false);
    builder.local_frame1(pose_to_parry(&first)).local_frame2(pose_to_parry(&align)).build()
}
