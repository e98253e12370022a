//! Reads a robot from URDF, through urdf-rs, and refuses what cannot be honoured by the name of its link or joint.
//!
//! Links come depth-first from the root, siblings in the order of the file's joints; the joints of `q` come in the
//! order of their links. Fixed joints are lumped: inertia by the parallel-axis theorem, collision shapes with their
//! pose. A fixed base drops the root link's own inertia and shapes (it is bolted to the world, at the world's origin)
//! and keeps fixed joints above the first moving ones as they are; the root of a floating robot is link 0. Links on fixed joints are
//! kept as frames. A joint with `<mimic>` has no coordinate of its own; see [`super::Mimic`]. Planar and floating joints: `several.rs`.

use std::collections::{HashMap, HashSet};

use nalgebra::Isometry3;
use urdf_rs::JointType;

use super::lump::{isometry, joint, lump, sound};
use super::mimic::follow;
use super::several::{TURN, freed, planar, unnamed};
use super::xml::without_materials;
use super::{Base, FixedFrame, Link, Robot};
use crate::spatial::BodyInertia;

/// Why a URDF cannot be honoured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
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
    /// A robot without a joint, bolted down.
    #[error("nothing moves: no moving joint and no floating base")]
    Still,
}

impl UrdfError {
    pub(super) fn link(link: &str, reason: impl AsRef<str>) -> Self {
        Self::Link { link: one_line(link), reason: one_line(reason.as_ref()) }
    }

    pub(super) fn joint(joint: &str, reason: impl AsRef<str>) -> Self {
        Self::Joint { joint: one_line(joint), reason: one_line(reason.as_ref()) }
    }
}

impl Robot {
    /// Reads a robot from the text of a URDF; `floating` frees its root link.
    ///
    /// Limits come without stiffness (it is not URDF's to say; nerd-sim's systems give them one), armature is zero, contact points are those of
    /// [`Robot::default_contact_points`].
    pub fn from_urdf(xml: &str, floating: bool) -> Result<Self, UrdfError> {
        Self::read(xml, floating, false)
    }

    /// The same from a URDF that nothing will be added to: a joint that carries no mass has no dynamics, and is fixed at zero. Its links
    /// become frames, and [`Robot::notes`] names it.
    ///
    /// # Errors
    /// As [`Robot::from_urdf`].
    pub fn from_urdf_alone(xml: &str, floating: bool) -> Result<Self, UrdfError> {
        Self::read(xml, floating, true)
    }

    fn read(xml: &str, floating: bool, alone: bool) -> Result<Self, UrdfError> {
        // An editor's mark of its encoding is no text.
        let plain = without_materials(xml.trim_start_matches('\u{feff}')).map_err(|e| UrdfError::Parse(one_line(&e)))?;
        // urdf-rs may panic on text that is no URDF at all; user input never does here.
        let parsed = std::panic::catch_unwind(|| urdf_rs::read_from_string(&plain));
        let file = parsed.unwrap_or_else(|_| Err("malformed text".into())).map_err(|e| UrdfError::Parse(one_line(&e.to_string())))?;
        unnamed(&file)?;
        let robot = Self::of(&file, floating)?;
        let idle = if alone { robot.idle() } else { Vec::new() };
        if idle.is_empty() {
            return Ok(robot);
        }
        let mut file = file;
        // Of a planar joint the last of its three carries what it carries.
        let own = |j: &urdf_rs::Joint| if j.joint_type == JointType::Planar { format!("{}.{TURN}", j.name) } else { j.name.clone() };
        let mut notes = Vec::new();
        for joint in file.joints.iter_mut().filter(|j| idle.contains(&own(j))) {
            joint.joint_type = JointType::Fixed;
            notes.push(format!("joint `{}`: it carries no mass, and is fixed at zero", joint.name));
        }
        let mut robot = Self::of(&file, floating)?;
        robot.notes.extend(notes);
        Ok(robot)
    }

    /// Joints without mass on them, nor on those that follow them.
    fn idle(&self) -> Vec<String> {
        let dofs = self.dofs();
        let mut carried: Vec<bool> = self.links.iter().map(|l| l.inertia.mass > 0.0 || l.inertia.inertia.amax() > 0.0).collect();
        for i in (0..carried.len()).rev() {
            if let Some(p) = self.links[i].parent {
                carried[p] |= carried[i];
            }
        }
        let idle =
            |dof: usize| dofs.iter().zip(&self.links).zip(&carried).all(|((d, l), carried)| *d != dof || l.joint.is_none() || !carried);
        let joints = self.links.iter().zip(&dofs).filter(|(_, dof)| idle(**dof));
        joints.filter_map(|(link, _)| link.joint.as_ref().map(|j| j.name.clone())).collect()
    }

    fn of(file: &urdf_rs::Robot, floating: bool) -> Result<Self, UrdfError> {
        let tree = Tree::new(file, floating)?;
        let base = if floating { Base::Floating } else { Base::Fixed(Isometry3::identity()) };
        let mut robot = Self::new(file.name.clone(), base);
        if floating {
            robot.links.push(bare(&file.links[tree.root], None, None));
        }
        tree.add(floating.then_some(0), &mut robot)?;
        for joint in file.joints.iter().filter(|j| tree.world.is_some_and(|world| file.links[world].name == j.parent.link)) {
            let said = joint.origin.xyz.iter().chain(&*joint.origin.rpy).any(|x| *x != 0.0) || joint.dynamics.is_some();
            if said || joint.mimic.is_some() {
                robot.notes.push(format!(
                    "joint `{}`: its <origin>, <dynamics> and <mimic> are passed over, since it makes the base a free one",
                    joint.name
                ));
            }
        }
        if robot.nv() == 0 {
            return Err(UrdfError::Still);
        }
        sound(&robot)?;
        robot.contact_points = robot.default_contact_points();
        Ok(robot)
    }
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
            [root] => match freed(file, root, &children[root]) {
                Some((joint, _)) if !floating => {
                    Err(UrdfError::joint(&file.joints[joint].name, "it is floating, and makes the base a free one: say `floating = true`"))
                }
                Some((_, child)) => Ok(Self { file, root: child, world: Some(root), children }),
                None => Ok(Self { file, root, world: None, children }),
            },
            [] if file.links.is_empty() => Err(UrdfError::Tree("there is no link at all".into())),
            [] => Err(UrdfError::Tree("every link hangs on another (a cycle)".into())),
            [a, b, ..] => Err(UrdfError::Tree(one_line(&format!("{} roots, among them `{}` and `{}`", roots.len(), name(a), name(b))))),
        }
    }

    /// Adds the root and all below it; `host` is the moving link the root belongs to, `None` for the world.
    fn add(&self, host: Option<usize>, robot: &mut Robot) -> Result<(), UrdfError> {
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
                    let (slides, turn) = planar(of, &source.name, pose, (host, robot.links.len()), &mut robot.notes)?;
                    robot.links.extend(slides);
                    host = Some(robot.links.len() - 1);
                    turn
                } else {
                    joint(of, pose, &mut robot.notes)?
                };
                robot.links.push(bare(source, host, Some(joint)));
                (host, pose) = (Some(robot.links.len() - 1), Isometry3::identity());
                followers.extend(of.mimic.as_ref().map(|mimic| (robot.links.len() - 1, mimic)));
            } else if host.is_none() || link != self.root {
                robot.frames.push(FixedFrame { name: source.name.clone(), link: host, pose });
            }
            if let Some(host) = host {
                lump(source, &pose, host, robot)?;
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
            None => follow(robot, self.file, followers),
        }
    }
}

/// A link of the file, nothing lumped in yet.
fn bare(source: &urdf_rs::Link, parent: Option<usize>, joint: Option<super::Joint>) -> Link {
    Link { name: source.name.clone(), parent, joint, inertia: BodyInertia::default(), shapes: Vec::new() }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
