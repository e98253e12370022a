//! Writes a system in a scene as MJCF, MuJoCo's model format, with the same bodies, joints and shapes to the last
//! digit.
//!
//! Joint limits match this crate's spring and damper (see `limit`). Contacts have the pair's friction and MuJoCo's
//! default softness, or match this crate's contact model as far as MuJoCo allows. Shapes that would need a mesh are
//! refused.

pub use crate::robots::mjcf::is_mjcf;

use crate::internal::*;
use crate::robots::world::inverse_weights;
use crate::scene::{Meeting, Softness};

/// A system that MJCF cannot represent; one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct MjcfError(String);

/// MuJoCo's smallest impedance. At this value the force of a constraint hardly depends on the inertia.
const MIN_IMPEDANCE: f64 = 1e-4;

/// Least radius (m) and range (rad or m) that MuJoCo accepts.
const MIN_SIZE: f64 = 1e-9;

/// Geoms of the scene collide with the robot's geoms and with nothing else.
const SCENE: &str = r#"contype="1" conaffinity="0""#;
const ROBOT: &str = r#"contype="0" conaffinity="1""#;
/// Geoms that collide only in explicit pairs.
const NONE: &str = r#"contype="0" conaffinity="0""#;

/// `system` in `scene` as MJCF; the caller sets integrator and time step. `drives` are empty or one per joint; each
/// becomes a MuJoCo actuator. Velocity limits are left out.
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
/// If the scene has colliders other than planes, boxes and cylinders, or the mass matrix is not positive definite. Also
/// for `<mimic>` joints and for weight taken off part of a link.
pub fn mjcf(system: &System, scene: &Scene, drives: &[Drive]) -> Result<String, MjcfError> {
    // A standing robot must not creep: MuJoCo's friction is by default as soft as its contacts.
    let hold = if drives.is_empty() { "" } else { " impratio=\"100\"" };
    written(system, scene, drives, hold, None)
}

/// As [`mjcf`], with position actuators (control: the target) where the robot's law acts inside a frame. Contacts match
/// this crate's stiffness, damping and tangential damping. All colliders must have one material.
pub fn mjcf_of_our_contact(system: &System, scene: &Scene) -> Result<String, MjcfError> {
    let material = scene.colliders.first().map(|collider| collider.material.mean(&system.spec.material));
    let hold = material.map_or_else(String::new, |m| format!(" impratio=\"{}\"", m.friction_damping / m.damping));
    let law = system.spec.control.filter(|law| law.servo);
    let servo = |(i, joint): (usize, &crate::system::JointSpec)| Drive {
        kp: joint.kp,
        kd: joint.kd,
        effort: system.torque_limit(i),
        ..Drive::default()
    };
    let servos: Vec<_> = system.joint_specs().enumerate().map(servo).take_while(|_| law.is_some()).collect();
    written(system, scene, &servos, &hold, material)
}

fn written(
    system: &System,
    scene: &Scene,
    drives: &[Drive],
    hold: &str,
    material: Option<Material>,
) -> Result<String, MjcfError> {
    let robot = &system.robot;
    expressible(robot)?;
    let mut text = format!(
        "<mujoco model=\"{}\">\n<compiler angle=\"radian\" inertiafromgeom=\"false\"/>\n<option gravity=\"{}\" cone=\"elliptic\"{hold}/>\n<worldbody>\n",
        escape(&system.name),
        numbers(scene.gravity.as_slice())
    );
    let means = || scene.colliders.iter().map(|collider| collider.material.mean(&system.spec.material));
    let paired = !system.surfaces.is_empty() || means().any(|m| [m.torsion, m.rolling, m.margin] != [0.0; 3]);
    for (k, (collider, mean)) in scene.colliders.iter().zip(means()).enumerate() {
        text += &scene_geom(scene, k, collider, (!paired).then_some(mean.friction), material.is_some())?;
    }
    let inverse = inverse_weights(robot).map_err(MjcfError)?;
    let soft = material.filter(|_| !paired).map(|m| inverse.iter().map(|w| softness(&m, *w)).collect());
    let mut geoms = paired.then(Vec::new);
    let own = Own {
        robot,
        scene,
        weight: weights(robot)?,
        soft: soft.unwrap_or_else(|| vec![String::new(); robot.links.len()]),
    };
    for (i, link) in robot.links.iter().enumerate().filter(|(_, l)| l.parent.is_none()) {
        let base =
            if let (Base::Fixed(pose), Some(_)) = (robot.base, &link.joint) { pose } else { Isometry3::identity() };
        own.body(&mut text, &mut geoms, i, &base, &[]);
    }
    text += "</worldbody>\n<actuator>\n";
    robot.joints().zip(drives).for_each(|(joint, drive)| text += &actuator(joint, drive));
    text += "</actuator>\n";
    if let Some(geoms) = geoms {
        text += &pairs(system, scene, &geoms, material.map(|_| &inverse[..]));
    }
    Ok(text + "</mujoco>\n")
}

/// Refuses robots that MuJoCo cannot express.
fn expressible(robot: &Robot) -> Result<(), MjcfError> {
    if let Some(joint) = robot.follower() {
        return Err(MjcfError(format!(
            "joint `{}` follows another (<mimic>), which MuJoCo's constraints hold only about",
            joint.name
        )));
    }
    let partly = |link: &&Link| {
        link.joint.is_some() && link.lifted.mass > 0.0 && (link.lifted.at - link.inertia.com).amax() > 1e-9
    };
    if let Some(link) = robot.links.iter().find(partly) {
        return Err(MjcfError(format!("weight is taken off a part of link `{}`, which no gravcomp says", link.name)));
    }
    Ok(())
}

/// Geom `k` of a scene. `friction`: `None` if contacts are by pair. `ours`: whether with this crate's softness.
fn scene_geom(
    scene: &Scene,
    k: usize,
    collider: &Collider,
    friction: Option<f64>,
    ours: bool,
) -> Result<String, MjcfError> {
    let (kind, size, place) = geom(collider).ok_or_else(|| {
        MjcfError(format!("scene `{}` is more than planes, boxes and cylinders; MuJoCo would need a mesh", scene.name))
    })?;
    // With this small `solmix`, the robot's geoms alone determine the softness of a contact.
    let mix = if ours { " solmix=\"1e-9\"" } else { "" };
    // MuJoCo takes the larger friction of a pair: the scene's geom has the pair's mean, the robot's geoms have none.
    let meets = match friction {
        Some(friction) => format!("friction=\"{friction}\"{mix} {SCENE}"),
        None => format!("name=\"scene {k}\" {NONE}"),
    };
    Ok(format!("<geom type=\"{kind}\" size=\"{size}\" {} {meets}/>\n", pose(&place)))
}

/// Every colliding pair of a robot geom (link and perhaps surface, from `geoms`) and a scene geom, with its contact
/// parameters. The softness matches our contact model by the links' inverse inertias, or comes from the robot's file.
fn pairs(system: &System, scene: &Scene, geoms: &[(usize, Option<usize>)], inverse: Option<&[f64]>) -> String {
    let mut text = "<contact>\n".to_string();
    for ((n, (link, surface)), (k, collider)) in
        geoms.iter().enumerate().flat_map(|g| scene.colliders.iter().enumerate().map(move |c| (g, c)))
    {
        let point = ContactPoint::new(*link, Vector3::zeros(), 0.0).on(*surface);
        let Some(Material { friction, torsion, rolling, margin, .. }) = system.meeting(&point, collider) else {
            continue;
        };
        let condim = if rolling > 0.0 {
            6
        } else if torsion > 0.0 {
            4
        } else {
            1 + 2 * usize::from(friction > 0.0)
        };
        let soft = match (inverse, system.surfaces.meeting(&point, collider), system.meeting(&point, collider)) {
            (Some(inverse), _, Some(material)) => softness(&material, inverse[*link]),
            (None, Some(Meeting::Law(law)), _) => {
                let Softness { solref, solimp } = law.softness;
                format!(" solref=\"{}\" solimp=\"{}\"", numbers(&solref), numbers(&solimp))
            }
            _ => String::new(),
        };
        let friction = numbers(&[friction, friction, torsion, rolling, rolling]);
        text += &format!(
            "<pair geom1=\"robot {n}\" geom2=\"scene {k}\" condim=\"{condim}\" friction=\"{friction}\" margin=\"{margin}\"{soft}/>\n"
        );
    }
    text + "</contact>\n"
}

/// Kind, size and pose of a geom of the scene.
fn geom(collider: &Collider) -> Option<(&'static str, String, Isometry3<f64>)> {
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f64::consts::FRAC_PI_2);
    if let Some(plane) = collider.plane {
        // A plane's normal is the z axis of its geom.
        let turn = rotation_from(&Vector3::z_axis(), &plane.normal);
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

/// Context for writing a robot: the scene, the inverse inertias of the joints, and by link the softness of its geoms.
struct Own<'a> {
    robot: &'a Robot,
    scene: &'a Scene,
    weight: Vec<f64>,
    soft: Vec<String>,
}

impl Own<'_> {
    /// Writes link `i` and its subtree. `base` is the pose of the parent frame in the enclosing body. Links are
    /// depth-first in the robot, in MuJoCo's body order, so the joints keep their order.
    ///
    /// MuJoCo has no massless bodies, but allows several joints on a body. A massless link between two joints is
    /// therefore left out, and its joint moves to the next link. `before` holds such links with their poses in the
    /// enclosing body. With contacts by pair, geoms collide only in pairs, and `geoms` receives link and surface of
    /// each geom.
    fn body(
        &self,
        text: &mut String,
        geoms: &mut Option<Vec<(usize, Option<usize>)>>,
        i: usize,
        base: &Isometry3<f64>,
        before: &[(usize, Isometry3<f64>)],
    ) {
        let robot = self.robot;
        let link = &self.robot.links[i];
        let origin = link.joint.as_ref().map_or(*base, |joint| base * joint.origin());
        let mut children = (i + 1..robot.links.len()).filter(|c| robot.links[*c].parent == Some(i));
        let nothing = link.inertia.mass == 0.0
            && link.inertia.inertia.amax() == 0.0
            && !robot.contact_points.iter().any(|p| p.link == i);
        if let (true, Some(_), Some(child), None) = (nothing, &link.joint, children.next(), children.next()) {
            let before: Vec<_> = before.iter().copied().chain([(i, origin)]).collect();
            return self.body(text, geoms, child, &origin, &before);
        }
        // MuJoCo reserves `world` for its fixed world; many URDFs use it for the root.
        let name = if link.name == "world" { "world link" } else { &link.name };
        // The inertia of a free root includes its armature; subtract the armature here, where the joint has it.
        let mut own = link.clone();
        let armature = if link.joint.is_none() { robot.free.armature } else { 0.0 };
        own.arm(-armature);
        let lifted = if own.lifted.mass > 0.0 {
            format!(" gravcomp=\"{}\"", own.lifted.mass / own.inertia.mass)
        } else {
            String::new()
        };
        *text += &format!("<body name=\"{}\"{lifted} {}>\n", escape(name), pose(&origin));
        for (i, place) in before.iter().copied().chain([(i, origin)]) {
            let own = |j| joint(j, &(origin.inverse() * place), self.weight[i - usize::from(robot.floating())]);
            let free = || match robot.free.damping {
                0.0 if armature == 0.0 => "<freejoint/>\n".into(),
                damping => format!("<joint type=\"free\" armature=\"{armature}\" damping=\"{damping}\"/>\n"),
            };
            *text += &robot.links[i].joint.as_ref().map_or_else(free, own);
        }
        *text += &inertial(&own);
        // The robot needs no shapes in an empty scene.
        if !self.scene.colliders.is_empty() {
            self.geoms(text, geoms, i);
        }
        for child in (i + 1..robot.links.len()).filter(|c| robot.links[*c].parent == Some(i)) {
            self.body(text, geoms, child, &Isometry3::identity(), &[]);
        }
        *text += "</body>\n";
    }

    /// Writes the geoms of link `i`, shapes and points; `geoms` as in [`Self::body`].
    fn geoms(&self, text: &mut String, geoms: &mut Option<Vec<(usize, Option<usize>)>>, i: usize) {
        let mut meets = |surface: Option<usize>| match geoms {
            Some(geoms) => {
                geoms.push((i, surface));
                format!("name=\"robot {}\" {NONE}", geoms.len() - 1)
            }
            None => format!("friction=\"0\"{} {ROBOT}", self.soft[i]),
        };
        let (shapes, points) = self.robot.touching(i);
        for shape in shapes {
            let (kind, size) = match shape.kind {
                ShapeKind::Box { half } => ("box", numbers(half.as_slice())),
                ShapeKind::Cylinder { radius, half_length } => ("cylinder", numbers(&[radius, half_length])),
                _ => continue,
            };
            *text += &format!(
                "<geom type=\"{kind}\" size=\"{size}\" {} mass=\"0\" {}/>\n",
                pose(&shape.pose),
                meets(shape.surface)
            );
        }
        for (at, point) in points.iter().flat_map(|p| p.places().into_iter().map(move |at| (at, p))) {
            let place = numbers(at.as_slice());
            let radius = point.radius.max(MIN_SIZE);
            *text += &format!(
                "<geom type=\"sphere\" size=\"{radius}\" pos=\"{place}\" mass=\"0\" {}/>\n",
                meets(point.surface)
            );
        }
    }
}

/// Writes a joint. `place`: pose of the joint frame in its body; `weight`: inverse inertia (1/kg or 1/(kg m^2)).
fn joint(joint: &Joint, place: &Isometry3<f64>, weight: f64) -> String {
    let kind = if joint.kind == JointKind::Prismatic { "slide" } else { "hinge" };
    let axis = if *place == Isometry3::identity() {
        joint.axis().into_inner()
    } else {
        place.rotation * joint.axis().into_inner()
    };
    let at = place.translation.vector;
    let at = if at.amax() == 0.0 { String::new() } else { format!(" pos=\"{}\"", numbers(at.as_slice())) };
    let axis = numbers(axis.as_slice());
    let limit = joint.limit.as_ref().map_or_else(String::new, |l| limit(l, weight));
    let name = escape(&joint.name);
    let Joint { armature, damping, friction, stiffness, rest, .. } = joint;
    let mut forces = format!("armature=\"{armature}\" damping=\"{damping}\" frictionloss=\"{friction}\"");
    if *stiffness > 0.0 {
        forces += &format!(" stiffness=\"{stiffness}\" springref=\"{rest}\"");
    }
    format!("<joint name=\"{name}\" type=\"{kind}\"{at} axis=\"{axis}\" {forces} {limit}/>\n")
}

/// Writes a drive as MuJoCo's affine bias `b_0 + b_1 q + b_2 qd`, limited to its effort. The control offsets the
/// target.
fn actuator(joint: &Joint, drive: &Drive) -> String {
    let Drive { kp, kd, target, speed, effort } = drive;
    let bias = numbers(&[kp * target + kd * speed, -kp, -kd]);
    let bounds = if effort.is_finite() {
        format!(" forcelimited=\"true\" forcerange=\"-{effort} {effort}\"")
    } else {
        String::new()
    };
    format!(
        "<general joint=\"{}\" gainprm=\"{kp}\" biastype=\"affine\" biasprm=\"{bias}\"{bounds}/>\n",
        escape(&joint.name)
    )
}

/// Writes a limit of stiffness k and damping d, which applies `-k r - d v` at excess r (rad or m) and rate v. MuJoCo
/// applies `f = (a_ref - a_0) / (A + R)` with `a_ref = -b v - k' r`, in accelerations. At the smallest impedance,
/// `R = A / 1e-4` outweighs A and a_0. Then `k' = k A` and `b = d A` match ours to 1e-4, but MuJoCo's limit never
/// pulls. The force is then explicit: a limit too stiff for one substep is unstable, unlike MuJoCo's default limits.
fn limit(limit: &Limit, weight: f64) -> String {
    if limit.stiffness <= 0.0 {
        return "limited=\"false\"".into();
    }
    let (k, d) = (limit.stiffness * weight, limit.damping * weight);
    // A locked joint also needs a range.
    let range = numbers(&[limit.lower, limit.upper.max(limit.lower + MIN_SIZE)]);
    format!(
        "limited=\"true\" range=\"{range}\" solreflimit=\"-{k} -{d}\" solimplimit=\"{MIN_IMPEDANCE} {MIN_IMPEDANCE} 1 0.5 1\""
    )
}

/// `(M^-1)_ii` of each joint at zero coordinates: the inverse inertia by which MuJoCo scales a joint's constraints.
fn weights(robot: &Robot) -> Result<Vec<f64>, MjcfError> {
    let mut data = Data::new(robot);
    let mut factor = Factor::new(robot);
    kinematics(robot, &robot.zero_state()[..robot.nq()], &mut data);
    crba(robot, &mut data);
    if !factor.refill(&data.mass) {
        return Err(MjcfError(factor.fault(robot)));
    }
    let column = |i: usize| {
        let mut x = vec![0.0; robot.nv()];
        x[i] = 1.0;
        factor.solve(&mut x);
        x[i]
    };
    Ok((robot.root_dofs()..robot.nv()).map(column).collect())
}

/// Softness of a geom that matches our spring and damper, as in [`limit`]. For contacts, MuJoCo's inverse inertia is
/// taken at the link's centre of mass at zero coordinates, as mean over directions.
fn softness(material: &Material, inverse: f64) -> String {
    let (k, d) = (material.stiffness * inverse, material.damping * inverse);
    format!(" solref=\"-{k} -{d}\" solimp=\"{MIN_IMPEDANCE} {MIN_IMPEDANCE} 1 0.5 1\"")
}

fn inertial(link: &Link) -> String {
    let mass = link.inertia.mass;
    let com = numbers(link.inertia.com.as_slice());
    let i = &link.inertia.inertia;
    let inertia = numbers(&[i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]]);
    format!("<inertial mass=\"{mass}\" pos=\"{com}\" fullinertia=\"{inertia}\"/>\n")
}

fn pose(pose: &Isometry3<f64>) -> String {
    let q = pose.rotation.quaternion();
    format!("pos=\"{}\" quat=\"{}\"", numbers(pose.translation.vector.as_slice()), numbers(&[q.w, q.i, q.j, q.k]))
}

fn numbers(x: &[f64]) -> String {
    x.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
