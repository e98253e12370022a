//! A robot as read from its file, the assumptions made, and the reasons for refusing a file.

use std::sync::Arc;

use super::Bodies;
use crate::prelude::*;

/// Content of a robot's file, URDF or another format read into [`super::Bodies`].
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfRobot {
    /// The robot.
    pub robot: Robot,
    /// Assumptions made where the file is silent, one line each.
    pub notes: Vec<String>,
    /// Collision meshes on moving links. The robot does not use them; a caller that reads the files may turn them into
    /// contact points.
    pub meshes: Vec<MeshFile>,
    /// Convex hulls of meshes that were read and of vertices given in the file.
    pub hulls: Vec<Hull>,
    /// Collision shapes of a fixed base, in its frame. They are not part of the robot.
    pub base: Vec<Shape>,
}

impl From<Robot> for UrdfRobot {
    fn from(robot: Robot) -> Self {
        Self { robot, notes: Vec::new(), meshes: Vec::new(), hulls: Vec::new(), base: Vec::new() }
    }
}

impl Robot {
    /// Reads a robot from the text of a URDF, on a base that is fixed (the root link is dropped) or floats (it is link
    /// 0). [`UrdfRobot::read`] also gives the assumptions made.
    ///
    /// Limits have no stiffness (URDF does not define one; nerd-sim's systems add it), armature is zero, contact points
    /// come from [`Robot::default_contact_points`].
    ///
    /// # Errors
    /// If the text cannot be honoured; names the link or joint and the reason.
    pub fn from_urdf(xml: &str, base: Base) -> Result<Self, UrdfError> {
        UrdfRobot::read(xml, base).map(|read| read.robot)
    }
}

impl UrdfRobot {
    /// As [`Robot::from_urdf`], with the assumptions made.
    pub fn read(xml: &str, base: Base) -> Result<Self, UrdfError> {
        let (bodies, notes) = Bodies::from_urdf(xml)?;
        let mut read = Self::of(&bodies, base)?;
        read.notes.splice(..0, notes);
        Ok(read)
    }
}

/// Convex hull of a collision mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Index of the moving link that carries it.
    pub link: usize,
    /// Vertices in that link's frame (m).
    pub vertices: Arc<[Vector3<f64>]>,
    /// Index of the contact properties in the file's table, if the file has one.
    pub surface: Option<usize>,
}

/// A collision mesh named in a robot's file.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// Index of the moving link that carries it.
    pub link: usize,
    /// Name of the mesh's body in the file.
    pub of: String,
    /// Pose in the moving link's frame.
    pub pose: Isometry3<f64>,
    /// Path of the mesh, as written in the robot's file.
    pub file: String,
    /// Scale factors along the mesh's axes.
    pub scale: Vector3<f64>,
    /// Index of the contact properties in the file's table, if the file has one.
    pub surface: Option<usize>,
}

/// Why a robot's file is refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// The fault in the text, a link, a joint or the tree of joints.
    #[error("{0}")]
    Refused(String),
    /// A robot without a joint on a fixed base.
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
