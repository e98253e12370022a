//! Reads a robot from URDF, through urdf-rs, and refuses what cannot be honoured by the name of its link or joint.
//!
//! Links come depth-first from the root, siblings in the order of the file's joints; the joints of `q` come in the
//! order of their links. Fixed joints are lumped: inertia by the parallel-axis theorem, collision shapes with their
//! pose. A fixed base drops the root link's own inertia; the root of a floating robot is link 0.

use std::collections::HashMap;

use nalgebra::{Isometry3, Matrix3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointType};

use super::{Base, Joint, JointKind, Limit, Link, Robot, Shape, ShapeKind};
use crate::spatial::BodyInertia;

/// Why a URDF cannot be honoured.
#[derive(Debug, thiserror::Error)]
pub enum UrdfError {
    /// Not a URDF.
    #[error("not a URDF: {0}")]
    Parse(String),
    /// A link that cannot be honoured.
    #[error("link `{link}`: {reason}")]
    Link {
        /// Its name.
        link: String,
        /// One line.
        reason: String,
    },
    /// A joint that cannot be honoured.
    #[error("joint `{joint}`: {reason}")]
    Joint {
        /// Its name.
        joint: String,
        /// One line.
        reason: String,
    },
    /// The links and joints do not make one tree.
    #[error("the joints do not make one tree: {0}")]
    Tree(String),
}

impl Robot {
    /// Reads a robot from the text of a URDF; `floating` frees its root link.
    ///
    /// Limits come without stiffness (it is not URDF's to say), armature is zero, contact points are those of
    /// [`Robot::default_contact_points`].
    pub fn from_urdf(xml: &str, floating: bool) -> Result<Self, UrdfError> {
        // urdf-rs may panic on text that is no URDF at all; user input never does here.
        let parsed = std::panic::catch_unwind(|| urdf_rs::read_from_string(xml));
        let file = parsed.map_err(|_| UrdfError::Parse("malformed text".into()))?.map_err(|e| UrdfError::Parse(one_line(&e.to_string())))?;
        let tree = Tree::new(&file)?;
        let mut robot = Robot { name: file.name.clone(), base: Base::Fixed(Isometry3::identity()), links: Vec::new(), contact_points: Vec::new(), skipped_meshes: Vec::new() };
        let root = if floating {
            robot.base = Base::Floating;
            robot.links.push(Link { name: file.links[tree.root].name.clone(), parent: None, joint: None, inertia: BodyInertia::default(), shapes: Vec::new() });
            Some(0)
        } else {
            None
        };
        tree.add(root, &mut robot)?;
        if robot.nv() == 0 {
            return Err(UrdfError::Tree("nothing moves: no moving joint and no floating base".into()));
        }
        robot.contact_points = robot.default_contact_points();
        Ok(robot)
    }
}

/// The file by index: children of each link, in the file's order.
struct Tree<'a> {
    file: &'a urdf_rs::Robot,
    root: usize,
    children: Vec<Vec<(usize, usize)>>,
}

impl<'a> Tree<'a> {
    fn new(file: &'a urdf_rs::Robot) -> Result<Self, UrdfError> {
        let mut index = HashMap::new();
        for (i, link) in file.links.iter().enumerate() {
            if index.insert(link.name.as_str(), i).is_some() {
                return Err(UrdfError::Link { link: link.name.clone(), reason: "name used twice".into() });
            }
        }
        let mut names = HashMap::new();
        let mut children = vec![Vec::new(); file.links.len()];
        let mut parents = vec![0usize; file.links.len()];
        for (j, joint) in file.joints.iter().enumerate() {
            let wrong = |reason: String| UrdfError::Joint { joint: joint.name.clone(), reason };
            if names.insert(joint.name.as_str(), j).is_some() {
                return Err(wrong("name used twice".into()));
            }
            let find = |name: &str| index.get(name).copied().ok_or_else(|| wrong(format!("unknown link `{name}`")));
            let (parent, child) = (find(&joint.parent.link)?, find(&joint.child.link)?);
            parents[child] += 1;
            if parents[child] > 1 {
                return Err(wrong(format!("link `{}` already hangs on another joint", joint.child.link)));
            }
            children[parent].push((j, child));
        }
        let roots: Vec<usize> = (0..file.links.len()).filter(|i| parents[*i] == 0).collect();
        match roots[..] {
            [root] => Ok(Self { file, root, children }),
            [] => Err(UrdfError::Tree("every link hangs on another (a cycle, or no link at all)".into())),
            _ => Err(UrdfError::Tree(format!("{} roots, among them `{}` and `{}`", roots.len(), file.links[roots[0]].name, file.links[roots[1]].name))),
        }
    }

    /// Adds the root and all below it; `host` is the moving link the root belongs to, `None` for the world.
    fn add(&self, host: Option<usize>, robot: &mut Robot) -> Result<(), UrdfError> {
        // An explicit stack, so that a deep file cannot overflow the program's. An entry: link, the moving link above
        // it, its pose there, and the joint it moves by, if it does.
        let mut stack = vec![(self.root, host, Isometry3::identity(), None)];
        while let Some((link, mut host, mut pose, moving)) = stack.pop() {
            let source = &self.file.links[link];
            if let Some(j) = moving {
                let joint = Some(joint(&self.file.joints[j], pose)?);
                robot.links.push(Link { name: source.name.clone(), parent: host, joint, inertia: BodyInertia::default(), shapes: Vec::new() });
                (host, pose) = (Some(robot.links.len() - 1), Isometry3::identity());
            }
            if let Some(host) = host {
                lump(source, &pose, host, robot)?;
            }
            for &(j, child) in self.children[link].iter().rev() {
                let joint = &self.file.joints[j];
                let origin = pose * isometry(&joint.origin).ok_or_else(|| joint_error(joint, "origin is not finite"))?;
                stack.push((child, host, origin, (joint.joint_type != JointType::Fixed).then_some(j)));
            }
        }
        Ok(())
    }
}

/// Welds a link of the file, at `pose` in moving link `host`, to it.
fn lump(source: &urdf_rs::Link, pose: &Isometry3<f64>, host: usize, robot: &mut Robot) -> Result<(), UrdfError> {
    let wrong = |reason: String| UrdfError::Link { link: source.name.clone(), reason };
    let origin = isometry(&source.inertial.origin).ok_or_else(|| wrong("inertial origin is not finite".into()))?;
    let i = &source.inertial.inertia;
    let inertia = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    let mass = source.inertial.mass.value;
    if !mass.is_finite() || mass < 0.0 || inertia.iter().any(|x| !x.is_finite()) {
        return Err(wrong(format!("mass {mass} kg or inertia is negative or not finite")));
    }
    let least = inertia.symmetric_eigenvalues().min();
    if least < -1e-9 * inertia.norm() {
        return Err(wrong(format!("inertia is not positive semi-definite (smallest eigenvalue {least:.3e} kg m^2)")));
    }
    let place = pose * origin;
    let body = BodyInertia { mass, com: Vector3::zeros(), inertia };
    let target = &mut robot.links[host];
    target.inertia = target.inertia.welded(&body.transformed(&place.rotation.to_rotation_matrix(), &place.translation.vector));
    for collision in &source.collision {
        let pose = pose * isometry(&collision.origin).ok_or_else(|| wrong("collision origin is not finite".into()))?;
        match shape(&collision.geometry) {
            Some(kind) if sizes(&kind).iter().all(|x| x.is_finite() && *x >= 0.0) => target.shapes.push(Shape { pose, kind }),
            Some(_) => return Err(wrong("a collision shape has a negative size, or one that is not finite".into())),
            None => robot.skipped_meshes.push(source.name.clone()),
        }
    }
    Ok(())
}

fn joint(source: &urdf_rs::Joint, origin: Isometry3<f64>) -> Result<Joint, UrdfError> {
    let wrong = |reason: &str| joint_error(source, reason);
    let kind = match source.joint_type {
        JointType::Revolute => JointKind::Revolute,
        JointType::Continuous => JointKind::Continuous,
        JointType::Prismatic => JointKind::Prismatic,
        ref other => return Err(wrong(&format!("type {other:?} is not supported; write it as revolute, continuous or prismatic joints"))),
    };
    if source.mimic.is_some() {
        return Err(wrong("<mimic> is not supported: every joint moves by itself"));
    }
    let axis = Vector3::from(*source.axis.xyz);
    let axis = Unit::try_new(axis, 1e-9).filter(|a| a.iter().all(|x| x.is_finite())).ok_or_else(|| wrong("axis has no direction"))?;
    let mut joint = Joint::new(source.name.clone(), kind, origin, axis);
    if let Some(dynamics) = &source.dynamics {
        if dynamics.friction != 0.0 {
            return Err(wrong("dry friction in <dynamics> is not supported; set friction=\"0\""));
        }
        if !dynamics.damping.is_finite() || dynamics.damping < 0.0 {
            return Err(wrong("damping is negative or not finite"));
        }
        joint.damping = dynamics.damping;
    }
    let (limit, given) = (&source.limit, |x: f64| if x.is_finite() && x > 0.0 { x } else { f64::INFINITY });
    (joint.effort, joint.velocity) = (given(limit.effort), given(limit.velocity));
    if kind != JointKind::Continuous && limit.lower.is_finite() && limit.upper.is_finite() {
        if limit.lower > limit.upper {
            return Err(wrong(&format!("lower limit {} is above upper limit {}", limit.lower, limit.upper)));
        }
        joint.limit = Some(Limit { lower: limit.lower, upper: limit.upper, stiffness: 0.0, damping: 0.0 });
    } else if limit.lower.is_nan() || limit.upper.is_nan() {
        return Err(wrong("a limit is not a number"));
    }
    Ok(joint)
}

fn joint_error(joint: &urdf_rs::Joint, reason: &str) -> UrdfError {
    UrdfError::Joint { joint: joint.name.clone(), reason: reason.into() }
}

/// `None` for a mesh, which is no primitive.
fn shape(geometry: &Geometry) -> Option<ShapeKind> {
    match geometry {
        Geometry::Box { size } => Some(ShapeKind::Box { half: Vector3::from(**size) * 0.5 }),
        Geometry::Cylinder { radius, length } => Some(ShapeKind::Cylinder { radius: *radius, half_length: 0.5 * length }),
        Geometry::Capsule { radius, length } => Some(ShapeKind::Capsule { radius: *radius, half_length: 0.5 * length }),
        Geometry::Sphere { radius } => Some(ShapeKind::Sphere { radius: *radius }),
        Geometry::Mesh { .. } => None,
    }
}

fn sizes(kind: &ShapeKind) -> [f64; 3] {
    match *kind {
        ShapeKind::Sphere { radius } => [radius, radius, radius],
        ShapeKind::Box { half } => half.into(),
        ShapeKind::Cylinder { radius, half_length } | ShapeKind::Capsule { radius, half_length } => [radius, half_length, radius],
    }
}

/// A URDF pose (roll, pitch, yaw about fixed axes), if finite.
fn isometry(pose: &urdf_rs::Pose) -> Option<Isometry3<f64>> {
    let ([x, y, z], [roll, pitch, yaw]) = (*pose.xyz, *pose.rpy);
    let finite = [x, y, z, roll, pitch, yaw].iter().all(|v| v.is_finite());
    finite.then(|| Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
