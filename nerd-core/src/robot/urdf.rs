//! Reads a robot from URDF, through urdf-rs, and refuses what is not supported by the name of its link or joint.
//!
//! Links come depth-first from the root, siblings in the order of the file's joints; the joints of `q` come in the
//! order of their links. Fixed joints are lumped: inertia by the parallel-axis theorem, collision shapes with their
//! pose. A fixed base drops the root link's own inertia (it is bolted to the world), hands out its shapes
//! ([`UrdfRobot::base`]) and keeps fixed joints above the first moving ones as they are; the root of a floating robot is link 0. Links on fixed joints are
//! kept as frames. A joint with `<mimic>` has no coordinate of its own; see [`super::Mimic`]. Planar joints: `planar.rs`. A floating
//! joint makes the base free if it is the one joint of a root link that is nothing but a name (`world`).

use std::collections::{HashMap, HashSet};

use urdf_rs::JointType;

use super::lump::{isometry, joint, lump, shapes, sound};
use super::planar::{TURN, check_names, planar};
use super::{mimic::follow, xml::prepared};
use crate::prelude::*;

impl Robot {
    /// Reads a robot from the text of a URDF, on a base that is fixed (the root link is dropped) or floats (it is link 0). What the text
    /// leaves open is in [`UrdfRobot::read`].
    ///
    /// Limits come without stiffness (it is not URDF's to say; nerd-sim's systems give them one), armature is zero, contact points are
    /// those of [`Robot::default_contact_points`].
    ///
    /// # Errors
    /// If the text cannot be honoured: which link or joint, and why.
    pub fn from_urdf(xml: &str, base: Base) -> Result<Self, UrdfError> {
        UrdfRobot::read(xml, base).map(|read| read.robot)
    }
}

impl UrdfRobot {
    /// Reads a robot as [`Robot::from_urdf`] does, and keeps what was taken for granted.
    pub fn read(xml: &str, base: Base) -> Result<Self, UrdfError> {
        Self::of(&parsed(xml)?, base)
    }

    /// The same from a URDF that nothing will be added to: a joint that carries no mass has no dynamics, and is fixed at zero. Its links
    /// become frames, and a note names it.
    pub fn read_alone(xml: &str, base: Base) -> Result<Self, UrdfError> {
        let mut file = parsed(xml)?;
        let read = Self::of(&file, base)?;
        let idle = idle(&read.robot);
        if idle.is_empty() {
            return Ok(read);
        }
        // Of a planar joint the last of its three carries what it carries.
        let own = |j: &urdf_rs::Joint| if j.joint_type == JointType::Planar { format!("{}.{TURN}", j.name) } else { j.name.clone() };
        let mut notes = Vec::new();
        for joint in file.joints.iter_mut().filter(|j| idle.contains(&own(j))) {
            joint.joint_type = JointType::Fixed;
            notes.push(format!("joint `{}`: it carries no mass, and is fixed at zero", joint.name));
        }
        let mut read = Self::of(&file, base)?;
        read.notes.extend(notes);
        Ok(read)
    }

    fn of(file: &urdf_rs::Robot, base: Base) -> Result<Self, UrdfError> {
        let floating = base == Base::Floating;
        let tree = Tree::new(file, floating)?;
        let mut read = Self::from(Robot::new(file.name.clone(), base));
        if floating {
            read.robot.links.push(bare(&file.links[tree.root], None, None));
        }
        tree.add(floating.then_some(0), &mut read)?;
        for joint in file.joints.iter().filter(|j| tree.world.is_some_and(|world| file.links[world].name == j.parent.link)) {
            let said = joint.origin.xyz.iter().chain(&*joint.origin.rpy).any(|x| *x != 0.0) || joint.dynamics.is_some();
            if said || joint.mimic.is_some() {
                read.notes.push(format!(
                    "joint `{}`: its <origin>, <dynamics> and <mimic> are passed over, since it makes the base free",
                    joint.name
                ));
            }
        }
        if read.robot.nv() == 0 {
            return Err(UrdfError::Still);
        }
        sound(&read.robot, &mut read.notes)?;
        read.robot.contact_points = read.robot.default_contact_points();
        Ok(read)
    }
}

fn parsed(xml: &str) -> Result<urdf_rs::Robot, UrdfError> {
    // An editor's mark of its encoding is no text.
    let plain = prepared(xml.trim_start_matches('\u{feff}'))?;
    if !plain.contains('<') {
        return Err(UrdfError::text("it has no element; the text of a URDF is needed, not its path"));
    }
    // urdf-rs may panic on text that is no URDF at all; user input never does here.
    let parsed = std::panic::catch_unwind(|| urdf_rs::read_from_string(&plain));
    let file = parsed.unwrap_or_else(|_| Err("malformed text".into())).map_err(|e| UrdfError::text(&e.to_string()))?;
    check_names(&file)?;
    Ok(file)
}

/// Joints without mass on them, nor on those that follow them.
fn idle(robot: &Robot) -> Vec<String> {
    let (links, dofs) = (&robot.links, robot.dofs());
    let mut carried: Vec<bool> = links.iter().map(|l| l.inertia.mass > 0.0 || l.inertia.inertia.amax() > 0.0).collect();
    for i in (0..carried.len()).rev() {
        if let Some(p) = links[i].parent {
            carried[p] |= carried[i];
        }
    }
    let idle = |dof: usize| dofs.iter().zip(links).zip(&carried).all(|((d, l), carried)| *d != dof || l.joint.is_none() || !carried);
    let joints = links.iter().zip(&dofs).filter(|(_, dof)| idle(**dof));
    joints.filter_map(|(link, _)| link.joint.as_ref().map(|j| j.name.clone())).collect()
}

/// The file by index: children of each link, in the file's order.
struct Tree<'a> {
    file: &'a urdf_rs::Robot,
    root: usize,
    /// The link above the root by a floating joint: a name for the world.
    world: Option<usize>,
    children: Vec<Vec<(usize, usize)>>,
}

impl<'a> Tree<'a> {
    fn new(file: &'a urdf_rs::Robot, floating: bool) -> Result<Self, UrdfError> {
        let mut index = HashMap::new();
        for (i, link) in file.links.iter().enumerate() {
            if index.insert(link.name.as_str(), i).is_some() {
                return Err(UrdfError::link(&link.name, "name used twice"));
            }
        }
        let mut names = HashSet::new();
        let mut children = vec![Vec::new(); file.links.len()];
        let mut parents = vec![0usize; file.links.len()];
        for (j, joint) in file.joints.iter().enumerate() {
            let wrong = |reason: String| UrdfError::joint(&joint.name, reason);
            if !names.insert(joint.name.as_str()) {
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
        let name = |i: usize| &file.links[i].name;
        match roots[..] {
            [root] => match floating_root(file, root, &children[root]) {
                Some((joint, _)) if !floating => {
                    Err(UrdfError::joint(&file.joints[joint].name, "it is floating, and makes the base free: write `floating = true`"))
                }
                Some((_, child)) => Ok(Self { file, root: child, world: Some(root), children }),
                None => Ok(Self { file, root, world: None, children }),
            },
            [] if file.links.is_empty() => Err(UrdfError::tree("there is no link at all")),
            [] => Err(UrdfError::tree("every link hangs on another (a cycle)")),
            [a, b, ..] => Err(UrdfError::tree(&format!("{} roots, among them `{}` and `{}`", roots.len(), name(a), name(b)))),
        }
    }

    /// Adds the root and all below it; `host` is the moving link the root belongs to, `None` for the world.
    fn add(&self, host: Option<usize>, read: &mut UrdfRobot) -> Result<(), UrdfError> {
        // An explicit stack, so that a deep file cannot overflow the program's. An entry: link, the moving link above
        // it, its pose there, and the joint it moves by, if it does.
        let mut stack = vec![(self.root, host, Isometry3::identity(), None)];
        let mut seen: Vec<bool> = (0..self.file.links.len()).map(|i| Some(i) == self.world).collect();
        let mut followers = Vec::new();
        while let Some((link, mut host, mut pose, moving)) = stack.pop() {
            seen[link] = true;
            let source = &self.file.links[link];
            if let Some(j) = moving {
                let of: &urdf_rs::Joint = &self.file.joints[j];
                let joint = if of.joint_type == JointType::Planar {
                    let (slides, turn) = planar(of, &source.name, host, pose, read.robot.links.len(), &mut read.notes)?;
                    read.robot.links.extend(slides);
                    host = Some(read.robot.links.len() - 1);
                    turn
                } else {
                    joint(of, pose, &mut read.notes)?
                };
                read.robot.links.push(bare(source, host, Some(joint)));
                (host, pose) = (Some(read.robot.links.len() - 1), Isometry3::identity());
                followers.extend(of.mimic.as_ref().map(|mimic| (read.robot.links.len() - 1, mimic)));
            } else if host.is_none() || link != self.root {
                read.robot.frames.push(FixedFrame { name: source.name.clone(), link: host, pose });
            }
            match host {
                Some(host) => lump(source, &pose, host, read)?,
                None => shapes(source, &pose, None, read)?,
            }
            for &(j, child) in self.children[link].iter().rev() {
                let joint = &self.file.joints[j];
                let origin = pose
                    * isometry(&joint.origin)
                        .ok_or_else(|| UrdfError::joint(&joint.name, "origin is not finite, or farther than 1e9 m or rad"))?;
                stack.push((child, host, origin, (joint.joint_type != JointType::Fixed).then_some(j)));
            }
        }
        match seen.iter().position(|s| !s) {
            Some(lost) => Err(UrdfError::link(&self.file.links[lost].name, "hangs in a cycle of joints, apart from the root")),
            None => follow(read, self.file, followers),
        }
    }
}

/// The joint from a root that is nothing but a name to a robot that floats, and the robot's own root.
fn floating_root(file: &urdf_rs::Robot, root: usize, children: &[(usize, usize)]) -> Option<(usize, usize)> {
    let link = &file.links[root];
    let bare = link.inertial.mass.value == 0.0 && link.collision.is_empty();
    match children {
        [(joint, child)] if bare && file.joints[*joint].joint_type == JointType::Floating => Some((*joint, *child)),
        _ => None,
    }
}

/// A link of the file, nothing lumped in yet.
fn bare(source: &urdf_rs::Link, parent: Option<usize>, joint: Option<super::Joint>) -> Link {
    Link { name: source.name.clone(), parent, joint, inertia: BodyInertia::default(), shapes: Vec::new() }
}
