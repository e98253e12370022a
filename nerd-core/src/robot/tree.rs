//! Builds a robot from its file's bodies.
//!
//! Links come depth-first from the root, siblings in the order of the file's joints. The joint coordinates of `q` come
//! in the order of the links. Fixed joints are lumped: inertia by the parallel-axis theorem, collision shapes with
//! their pose. Bodies on fixed joints become frames. A fixed base drops the root body's inertia and returns its shapes
//! ([`UrdfRobot::base`]). The root of a floating robot is link 0. A mimic joint adds no coordinate; see
//! [`super::Mimic`]. `planar.rs` splits planar joints. A floating joint makes the base free if it is the only joint of
//! an empty root body (`world`).

use super::lump::{joint, lump, shapes, sound};
use super::planar::{TURN, check_names, planar};
use super::{Bodies, Body, BodyJoint, BodyJointKind, mimic::follow};
use crate::prelude::*;

impl UrdfRobot {
    /// The robot made of `bodies`. On a fixed base the root body is dropped; on a floating base the root body is link
    /// 0. Contact points come from [`Robot::default_contact_points`].
    ///
    /// # Errors
    /// If the joints form no tree, nothing moves, or an inertia is physically impossible. The error names the body or
    /// joint and the reason.
    pub fn of(bodies: &Bodies, base: Base) -> Result<Self, UrdfError> {
        check_names(bodies)?;
        let floating = base == Base::Floating;
        let tree = Tree::new(bodies, floating)?;
        let mut read = Self::from(Robot::new(bodies.name.clone(), base));
        if floating {
            read.robot.links.push(bare(&bodies.bodies[tree.root], None, None));
        }
        tree.add(floating.then_some(0), &mut read)?;
        if read.robot.nv() == 0 {
            return Err(UrdfError::Still);
        }
        if floating {
            read.robot.free = bodies.free;
            read.robot.links[0].arm(bodies.free.armature);
        }
        sound(&read.robot, &mut read.notes)?;
        read.robot.contact_points = read.robot.default_contact_points();
        Ok(read)
    }

    /// Like `Self::of`, for a robot that gets no armature or other inertia later. A joint that carries no mass has no
    /// dynamics, so it is fixed at zero. Its bodies become frames, and a note names the joint.
    pub fn of_alone(bodies: &Bodies, base: Base) -> Result<Self, UrdfError> {
        let read = Self::of(bodies, base)?;
        let idle = idle(&read.robot);
        if idle.is_empty() {
            return Ok(read);
        }
        // The last of a planar joint's three joints carries the child link.
        let own =
            |j: &BodyJoint| if j.kind == BodyJointKind::Planar { format!("{}.{TURN}", j.name) } else { j.name.clone() };
        let mut bodies = bodies.clone();
        let mut notes = Vec::new();
        for joint in bodies.joints.iter_mut().filter(|j| idle.contains(&own(j))) {
            joint.kind = BodyJointKind::Fixed;
            notes.push(format!("joint `{}`: it carries no mass, and is fixed at zero", joint.name));
        }
        let mut read = Self::of(&bodies, base)?;
        read.notes.extend(notes);
        Ok(read)
    }
}

/// Names of the joints that carry no mass, neither themselves nor through the mimic joints that follow them.
fn idle(robot: &Robot) -> Vec<String> {
    let links = &robot.links;
    let dofs = robot.dofs();
    let mut carried: Vec<bool> = links.iter().map(|l| l.inertia.mass > 0.0 || l.inertia.inertia.amax() > 0.0).collect();
    for i in (0..carried.len()).rev() {
        if let Some(p) = links[i].parent {
            carried[p] |= carried[i];
        }
    }
    let idle = |dof: usize| {
        dofs.iter().zip(links).zip(&carried).all(|((d, l), carried)| *d != dof || l.joint.is_none() || !carried)
    };
    let joints = links.iter().zip(&dofs).filter(|(_, dof)| idle(**dof));
    joints.filter_map(|(link, _)| link.joint.as_ref().map(|j| j.name.clone())).collect()
}

/// The file's bodies as a tree: the joints that hang on each body, in the file's order.
struct Tree<'a> {
    file: &'a Bodies,
    root: usize,
    /// The empty body above a floating joint at the root, if any; it stands for the world.
    world: Option<usize>,
    children: Vec<Vec<&'a BodyJoint>>,
}

impl<'a> Tree<'a> {
    fn new(file: &'a Bodies, floating: bool) -> Result<Self, UrdfError> {
        let count = file.bodies.len();
        let mut children = vec![Vec::new(); count];
        let mut hangs = vec![false; count];
        for joint in &file.joints {
            if joint.parent.max(joint.child) >= count {
                return Err(UrdfError::joint(&joint.name, format!("there are {count} bodies, and none of its index")));
            }
            if std::mem::replace(&mut hangs[joint.child], true) {
                let child = &file.bodies[joint.child].name;
                return Err(UrdfError::joint(&joint.name, format!("link `{child}` already hangs on another joint")));
            }
            children[joint.parent].push(joint);
        }
        let roots: Vec<usize> = (0..count).filter(|i| !hangs[*i]).collect();
        let name = |i: usize| &file.bodies[i].name;
        match roots[..] {
            [root] => match floating_root(&file.bodies[root], &children[root]) {
                Some(joint) if !floating => Err(UrdfError::joint(
                    &joint.name,
                    "it is floating, and makes the base free: write `floating = true`",
                )),
                Some(joint) => Ok(Self { file, root: joint.child, world: Some(root), children }),
                None => Ok(Self { file, root, world: None, children }),
            },
            [] if count == 0 => Err(UrdfError::tree("there is no link at all")),
            [] => Err(UrdfError::tree("every link hangs on another (a cycle)")),
            [a, b, ..] => {
                Err(UrdfError::tree(&format!("{} roots, among them `{}` and `{}`", roots.len(), name(a), name(b))))
            }
        }
    }

    /// Adds the root and all its descendants; `host` is the moving link of the root, `None` for a fixed base.
    fn add(&self, host: Option<usize>, read: &mut UrdfRobot) -> Result<(), UrdfError> {
        // An explicit stack, so that a deep tree cannot overflow the call stack. An entry holds a body, the moving link
        // above the body, the body's pose in that link, and its moving joint, if any.
        let mut stack = vec![(self.root, host, Isometry3::identity(), None)];
        let mut seen: Vec<bool> = (0..self.file.bodies.len()).map(|i| Some(i) == self.world).collect();
        let mut followers = Vec::new();
        while let Some((body, mut host, mut pose, moving)) = stack.pop() {
            seen[body] = true;
            let source = &self.file.bodies[body];
            if let Some(of) = moving {
                let of: &BodyJoint = of;
                let joint = if of.kind == BodyJointKind::Planar {
                    let (slides, turn) = planar(of, &source.name, host, pose, read.robot.links.len());
                    read.robot.links.extend(slides);
                    host = Some(read.robot.links.len() - 1);
                    turn
                } else {
                    joint(of, pose)?
                };
                read.robot.links.push(bare(source, host, Some(joint)));
                (host, pose) = (Some(read.robot.links.len() - 1), Isometry3::identity());
                followers.extend(of.mimic.as_ref().map(|mimic| (read.robot.links.len() - 1, mimic)));
            } else if host.is_none() || body != self.root {
                read.robot.frames.push(FixedFrame { name: source.name.clone(), link: host, pose: pose * source.frame });
            }
            match host {
                Some(host) => lump(source, &pose, host, read)?,
                None => shapes(source, &pose, None, read),
            }
            for &joint in self.children[body].iter().rev() {
                stack.push((
                    joint.child,
                    host,
                    pose * joint.origin,
                    (joint.kind != BodyJointKind::Fixed).then_some(joint),
                ));
            }
        }
        match seen.iter().position(|s| !s) {
            Some(lost) => {
                Err(UrdfError::link(&self.file.bodies[lost].name, "hangs in a cycle of joints, apart from the root"))
            }
            None => follow(read, followers),
        }
    }
}

/// The only joint of the root body, if it is floating and the body has neither mass nor collision solids.
fn floating_root<'a>(root: &Body, children: &[&'a BodyJoint]) -> Option<&'a BodyJoint> {
    let bare = root.inertia.mass == 0.0 && root.collisions.is_empty();
    match children {
        [joint] if bare && joint.kind == BodyJointKind::Floating => Some(joint),
        _ => None,
    }
}

/// The link of a moving body, still without inertia and shapes.
fn bare(source: &Body, parent: Option<usize>, joint: Option<Joint>) -> Link {
    Link { frame: source.frame, ..Link::new(source.name.clone(), parent, joint, BodyInertia::default()) }
}
