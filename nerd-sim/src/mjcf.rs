//! A system in a scene as MJCF, MuJoCo's own text: the same bodies, joints and shapes, to the last digit.
//!
//! A link's frame is its joint's frame, so bodies nest with the joints' origins and every joint sits at its body's origin.
//! Limits are our spring and damper (see `limit`); contacts are MuJoCo's own, soft constraints with its default
//! settings, with the friction of the pair, or ours as far as MuJoCo's may be. What it would need a mesh for is refused.

pub use crate::system::mjcf::is_mjcf;

use nerd_core::{dynamics::Axes, robot::FixedFrame};

use crate::internal::*;
use crate::system::mjcf::{escape, numbers};

/// Why a system cannot be written for MuJoCo; one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct MjcfError(String);

/// MuJoCo's least impedance: a constraint that weak pushes with the force it is given and hardly feels what it pushes.
const WEAKEST: f64 = 1e-4;

/// Least radius (m) and range (rad or m) that it takes for some.
const LEAST: f64 = 1e-9;

/// Geoms of the scene touch those of the robot and nothing else.
const SCENE: &str = r#"contype="1" conaffinity="0""#;
const ROBOT: &str = r#"contype="0" conaffinity="1""#;

/// `system` in `scene` as MJCF; the integrator and the step are the caller's to set. A drive on every joint becomes an actuator of MuJoCo's;
/// largest velocities are left out.
///
/// ```
/// use nerd_sim::prelude::*;
/// let system = System::named("pendulum")?;
/// let text = nerd_sim::mjcf::mjcf(&system, &*system.scene("ground1")?, &[])?;
/// assert!(text.starts_with("<mujoco"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the scene is more than planes, boxes and cylinders, or the robot's mass matrix is none.
pub fn mjcf(system: &System, scene: &Scene, drives: &[Drive]) -> Result<String, MjcfError> {
    // A standing robot must not creep: by default MuJoCo's friction is as soft as its contacts.
    let hold = if drives.is_empty() { "" } else { " impratio=\"100\"" };
    written(system, scene, drives, hold, None)
}

/// The same without drives, and with contacts of the stiffness, damping and drag that ours have in this scene, all of whose colliders are of
/// one material.
pub fn mjcf_of_our_contact(system: &System, scene: &Scene) -> Result<String, MjcfError> {
    let material = scene.colliders.first().map(|collider| collider.material.mean(&system.spec.material));
    let hold = material.map_or_else(String::new, |m| format!(" impratio=\"{}\"", m.friction_damping / m.damping));
    written(system, scene, &[], &hold, material)
}

fn written(system: &System, scene: &Scene, drives: &[Drive], hold: &str, material: Option<Material>) -> Result<String, MjcfError> {
    let robot = &system.robot;
    if let Some(joint) = robot.follower() {
        return Err(MjcfError(format!("joint `{}` follows another (<mimic>), which MuJoCo's constraints hold only about", joint.name)));
    }
    let mut text = format!(
        "<mujoco model=\"{}\">\n<compiler angle=\"radian\" inertiafromgeom=\"false\"/>\n<option gravity=\"{}\" cone=\"elliptic\"{hold}/>\n<worldbody>\n",
        escape(&system.name),
        numbers(scene.gravity.as_slice())
    );
    for collider in &scene.colliders {
        let (kind, size, place) = geom(collider).ok_or_else(|| {
            MjcfError(format!("scene `{}` is more than planes, boxes and cylinders; MuJoCo would need a mesh", scene.name))
        })?;
        // MuJoCo takes the larger friction of a pair: the scene's geom has the pair's mean, the robot's have none.
        let friction = collider.material.mean(&system.spec.material).friction;
        // What the robot's geoms say of a contact's softness is said of both.
        let mix = if material.is_some() { " solmix=\"1e-9\"" } else { "" };
        text += &format!("<geom type=\"{kind}\" size=\"{size}\" {} friction=\"{friction}\"{mix} {SCENE}/>\n", pose(&place));
    }
    let weight = weights(robot)?;
    let soft = material.map_or_else(|| Ok(vec![String::new(); robot.links.len()]), |m| softness(robot, &m))?;
    for (i, link) in robot.links.iter().enumerate().filter(|(_, l)| l.parent.is_none()) {
        let base = if let (Base::Fixed(pose), Some(_)) = (robot.base, &link.joint) { pose } else { Isometry3::identity() };
        body(&mut text, robot, scene, (&weight, &soft), i, &base, &[]);
    }
    text += "</worldbody>\n<actuator>\n";
    robot.joints().zip(drives).for_each(|(joint, drive)| text += &actuator(joint, drive));
    text += "</actuator>\n</mujoco>\n";
    Ok(text)
}

/// Kind, size and pose of a geom of the scene.
fn geom(collider: &Collider) -> Option<(&'static str, String, Isometry3<f64>)> {
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f64::consts::FRAC_PI_2);
    if let Some(plane) = collider.plane {
        // Its geom's z axis points out of a plane.
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &plane.normal)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        return Some(("plane", "0 0 1".into(), Isometry3::from_parts((plane.normal * plane.offset).into(), turn)));
    }
    if let Some(cuboid) = collider.shape.as_cuboid() {
        let half = cuboid.half_extents;
        return Some(("box", numbers(&[half.x, half.y, half.z]), collider.pose));
    }
    // Parry's cylinders lie along y, MuJoCo's along z.
    let cylinder = collider.shape.as_cylinder()?;
    Some(("cylinder", numbers(&[cylinder.radius, cylinder.half_height]), collider.pose * quarter))
}

/// Link `i` and all that hangs on it; `base` is where its parent's frame stands in the body it is nested in. Links stand
/// depth-first in the robot, as MuJoCo counts its bodies, so the joints keep their order.
///
/// MuJoCo has no body that weighs nothing, but bodies with several joints: a link that weighs nothing between two joints is left out, and
/// its joint becomes one of the next link's. `before` are such links, with their frames as `base` is.
fn body(
    text: &mut String,
    robot: &Robot,
    scene: &Scene,
    (weight, soft): (&[f64], &[String]),
    i: usize,
    base: &Isometry3<f64>,
    before: &[(usize, Isometry3<f64>)],
) {
    let link = &robot.links[i];
    let origin = link.joint.as_ref().map_or(*base, |joint| base * joint.origin());
    let mut children = (i + 1..robot.links.len()).filter(|c| robot.links[*c].parent == Some(i));
    let nothing = link.inertia.mass == 0.0 && link.inertia.inertia.amax() == 0.0 && !robot.contact_points.iter().any(|p| p.link == i);
    if let (true, Some(_), Some(child), None) = (nothing, &link.joint, children.next(), children.next()) {
        let before: Vec<_> = before.iter().copied().chain([(i, origin)]).collect();
        return body(text, robot, scene, (weight, soft), child, &origin, &before);
    }
    // MuJoCo's own name of what nothing moves, and many a URDF's name of its root.
    let name = if link.name == "world" { "world link" } else { &link.name };
    *text += &format!("<body name=\"{}\" {}>\n", escape(name), pose(&origin));
    for (i, place) in before.iter().copied().chain([(i, origin)]) {
        let own = |j| joint(j, &(origin.inverse() * place), weight[i - usize::from(robot.floating())]);
        *text += &robot.links[i].joint.as_ref().map_or_else(|| "<freejoint/>\n".into(), own);
    }
    *text += &inertial(link);
    // Without anything to touch the robot needs no shapes.
    if !scene.colliders.is_empty() {
        let (shapes, points) = robot.touching(i);
        for shape in shapes {
            let (kind, size) = match shape.kind {
                ShapeKind::Box { half } => ("box", numbers(half.as_slice())),
                ShapeKind::Cylinder { radius, half_length } => ("cylinder", numbers(&[radius, half_length])),
                _ => continue,
            };
            *text +=
                &format!("<geom type=\"{kind}\" size=\"{size}\" {} mass=\"0\" friction=\"0\"{} {ROBOT}/>\n", pose(&shape.pose), soft[i]);
        }
        for (at, radius) in points.iter().flat_map(|p| p.places().into_iter().map(|at| (at, p.radius.max(LEAST)))) {
            let place = numbers(at.as_slice());
            *text += &format!("<geom type=\"sphere\" size=\"{radius}\" pos=\"{place}\" mass=\"0\" friction=\"0\"{} {ROBOT}/>\n", soft[i]);
        }
    }
    for child in (i + 1..robot.links.len()).filter(|c| robot.links[*c].parent == Some(i)) {
        body(text, robot, scene, (weight, soft), child, &Isometry3::identity(), &[]);
    }
    *text += "</body>\n";
}

/// `place` is the joint's frame in its body's.
fn joint(joint: &Joint, place: &Isometry3<f64>, weight: f64) -> String {
    let kind = if joint.kind == JointKind::Prismatic { "slide" } else { "hinge" };
    let axis = if *place == Isometry3::identity() { joint.axis().into_inner() } else { place.rotation * joint.axis().into_inner() };
    let at = place.translation.vector;
    let at = if at.amax() == 0.0 { String::new() } else { format!(" pos=\"{}\"", numbers(at.as_slice())) };
    let (axis, limit) = (numbers(axis.as_slice()), joint.limit.as_ref().map_or_else(String::new, |l| limit(l, weight)));
    let name = escape(&joint.name);
    let Joint { armature, damping, friction, stiffness, rest, .. } = joint;
    let mut forces = format!("armature=\"{armature}\" damping=\"{damping}\" frictionloss=\"{friction}\"");
    if *stiffness > 0.0 {
        forces += &format!(" stiffness=\"{stiffness}\" springref=\"{rest}\"");
    }
    format!("<joint name=\"{name}\" type=\"{kind}\"{at} axis=\"{axis}\" {forces} {limit}/>\n")
}

/// A drive: `b_0 + b_1 q + b_2 qd` of MuJoCo's affine bias, kept within its effort; its control moves the target.
fn actuator(joint: &Joint, drive: &Drive) -> String {
    let Drive { kp, kd, target, speed, effort } = drive;
    let bias = numbers(&[kp * target + kd * speed, -kp, -kd]);
    let bounds = if effort.is_finite() { format!(" forcelimited=\"true\" forcerange=\"-{effort} {effort}\"") } else { String::new() };
    format!("<general joint=\"{}\" gainprm=\"{kp}\" biastype=\"affine\" biasprm=\"{bias}\"{bounds}/>\n", escape(&joint.name))
}

/// A limit of stiffness k and damping d, beyond an end `-k r - d v`. MuJoCo's is `f = (a_ref - a_0) / (A + R)` with
/// `a_ref = -b v - k' r` in accelerations: as weak as it may be, `R = A / 1e-4` outweighs A and a_0, and
/// `k' = k A`, `b = d A` make it ours to 1e-4, except that it never pulls. As weak as
/// that it is as explicit as ours: too stiff for one substep, where MuJoCo's own limits would hold.
fn limit(limit: &Limit, weight: f64) -> String {
    if limit.stiffness <= 0.0 {
        return "limited=\"false\"".into();
    }
    let (k, d) = (limit.stiffness * weight, limit.damping * weight);
    // A joint that is locked needs a range, too.
    let range = numbers(&[limit.lower, limit.upper.max(limit.lower + LEAST)]);
    format!("limited=\"true\" range=\"{range}\" solreflimit=\"-{k} -{d}\" solimplimit=\"{WEAKEST} {WEAKEST} 1 0.5 1\"")
}

/// The mass matrix at zero coordinates.
fn factored(robot: &Robot) -> Result<Factor, MjcfError> {
    let (mut data, mut factor) = (Data::new(robot), Factor::new(robot));
    kinematics(robot, &robot.zero_state()[..robot.nq()], &mut data);
    crba(robot, &mut data);
    if factor.refill(&data.mass) { Ok(factor) } else { Err(MjcfError(factor.fault(robot))) }
}

/// `(M^-1)_ii` of each joint at zero coordinates: the inertia by which MuJoCo scales a joint's constraints.
fn weights(robot: &Robot) -> Result<Vec<f64>, MjcfError> {
    let factor = factored(robot)?;
    let column = |i: usize| {
        let mut x = vec![0.0; robot.nv()];
        x[i] = 1.0;
        factor.solve(&mut x);
        x[i]
    };
    Ok((robot.root_dofs()..robot.nv()).map(column).collect())
}

/// By link, the settings of its geoms by which a contact is a spring and a damper as ours, in the way of [`limit`]: MuJoCo's inertia of a contact
/// is that of the link's centre of mass at zero coordinates, the mean over directions.
fn softness(robot: &Robot, material: &Material) -> Result<Vec<String>, MjcfError> {
    let (mut data, state) = (Data::new(robot), robot.zero_state());
    let factor = factored(robot)?;
    let of = |(link, own): (usize, &Link)| {
        let pose = Isometry3::from_parts(own.inertia.com.into(), UnitQuaternion::identity());
        let frame = FixedFrame { name: String::new(), link: Some(link), pose };
        let rows = data.jacobian(robot, &state[..robot.nq()], &frame, Axes::World).fixed_rows::<3>(3).transpose();
        let weight = rows.column_iter().map(|row| {
            let mut x: Vec<f64> = row.iter().copied().collect();
            factor.solve(&mut x);
            x.iter().zip(row.iter()).map(|(a, b)| a * b).sum::<f64>() / 3.0
        });
        let weight: f64 = weight.sum();
        let (k, d) = (material.stiffness * weight, material.damping * weight);
        format!(" solref=\"-{k} -{d}\" solimp=\"{WEAKEST} {WEAKEST} 1 0.5 1\"")
    };
    Ok(robot.links.iter().enumerate().map(of).collect())
}

fn inertial(link: &Link) -> String {
    let (mass, com, i) = (link.inertia.mass, numbers(link.inertia.com.as_slice()), &link.inertia.inertia);
    let inertia = numbers(&[i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]]);
    format!("<inertial mass=\"{mass}\" pos=\"{com}\" fullinertia=\"{inertia}\"/>\n")
}

fn pose(pose: &Isometry3<f64>) -> String {
    let q = pose.rotation.quaternion();
    format!("pos=\"{}\" quat=\"{}\"", numbers(pose.translation.vector.as_slice()), numbers(&[q.w, q.i, q.j, q.k]))
}
