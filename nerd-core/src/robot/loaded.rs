//! A robot as read from its file, with notes on what the file leaves open; and why a file is refused.

use std::sync::Arc;

use super::Bodies;
use crate::prelude::*;

/// Content of a robot's file, a URDF or any other format that is read into [`super::Bodies`].
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfRobot {
    /// The robot.
    pub robot: Robot,
    /// Assumptions made where the file is silent, a line each.
    pub notes: Vec<String>,
    /// Collision meshes on moving links, which the robot does not use; a caller that can read files may turn them into contact points.
    pub meshes: Vec<MeshFile>,
    /// Convex hulls: of meshes that were read, and those given in the file.
    pub hulls: Vec<Hull>,
    /// Collision shapes of a fixed base, in its frame; they are not part of the robot.
    pub base: Vec<Shape>,
}

impl From<Robot> for UrdfRobot {
    fn from(robot: Robot) -> Self {
        Self { robot, notes: Vec::new(), meshes: Vec::new(), hulls: Vec::new(), base: Vec::new() }
    }
}

impl Robot {
    /// Reads a robot from the text of a URDF, on a base that is fixed (the root link is dropped) or floats (it is link 0).
    /// [`UrdfRobot::read`] also gives the assumptions made.
    ///
    /// Limits have no stiffness (URDF does not define one; nerd-sim's systems add it), armature is zero, contact points come from
    /// [`Robot::default_contact_points`].
    ///
    /// # Errors
    /// If the text cannot be honoured; names the link or joint and the reason.
    pub fn from_urdf(xml: &str, base: Base) -> Result<Self, UrdfError> {
        UrdfRobot::read(xml, base).map(|read| read.robot)
    }
}

impl UrdfRobot {
    /// Reads a robot as [`Robot::from_urdf`] does, and keeps the assumptions made.
    pub fn read(xml: &str, base: Base) -> Result<Self, UrdfError> {
        let (bodies, notes) = Bodies::from_urdf(xml)?;
        Ok(Self::of(&bodies, base)?.noted(notes))
    }

    /// The same for a URDF to which nothing will be added; see [`UrdfRobot::of_alone`].
    pub fn read_alone(xml: &str, base: Base) -> Result<Self, UrdfError> {
        let (bodies, notes) = Bodies::from_urdf(xml)?;
        Ok(Self::of_alone(&bodies, base)?.noted(notes))
    }

    fn noted(mut self, notes: Vec<String>) -> Self {
        self.notes.splice(..0, notes);
        self
    }
}

/// The convex hull of a collision mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Index of the moving link that carries it.
    pub link: usize,
    /// Its vertices in that link's frame (m).
    pub vertices: Arc<[Vector3<f64>]>,
    /// Index of its contact properties in the file's table, where a file has one.
    pub surface: Option<usize>,
}

/// A collision mesh that a robot's file names.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// Index of the moving link that carries it.
    pub link: usize,
    /// Name of its body in the file.
    pub of: String,
    /// Where it is in the moving link's frame.
    pub pose: Isometry3<f64>,
    /// The mesh's file, as the robot's file names it.
    pub file: String,
    /// Factors on its lengths, along its own axes.
    pub scale: Vector3<f64>,
    /// Index of its contact properties in the file's table, where a file has one.
    pub surface: Option<usize>,
}

/// Why a robot's file cannot be honoured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// The fault: in the text, a link, a joint, or the tree that they make.
    #[error("{0}")]
    Refused(String),
    /// A robot without a joint, bolted down.
    #[error("nothing moves: no moving joint and no floating base")]
    Still,
}

impl UrdfError {
    pub(super) fn text(reason: &str) -> Self {
        Self::Refused(one_line(&format!("not a URDF: {reason}")))
    }

    pub(super) fn tree(reason: &str) -> Self {
        Self::Refused(one_line(&format!("the joints do not make one tree: {reason}")))
    }

    pub(super) fn link(link: &str, reason: impl AsRef<str>) -> Self {
        Self::Refused(one_line(&format!("link `{link}`: {}", reason.as_ref())))
    }

    pub(super) fn joint(joint: &str, reason: impl AsRef<str>) -> Self {
        Self::Refused(one_line(&format!("joint `{joint}`: {}", reason.as_ref())))
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
