//! A robot as read from its file, the assumptions made, and the reasons for refusing a file.

use std::sync::Arc;

use super::Bodies;
use crate::prelude::*;

/// Content of a robot's file: a URDF, or another format that was read into [`super::Bodies`].
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfRobot {
    /// The robot.
    pub robot: Robot,
    /// Assumptions made where the file is silent, one line each.
    pub notes: Vec<String>,
    /// Collision meshes on moving links. The robot does not use these meshes; a caller may read their files and turn
    /// the meshes into contact points.
    pub meshes: Vec<MeshFile>,
    /// Convex hulls: of meshes that were read, and of vertices given in the file.
    pub hulls: Vec<Hull>,
    /// Collision shapes of a fixed base, in the base's frame. These shapes are not part of the robot.
    pub base: Vec<Shape>,
}

impl From<Robot> for UrdfRobot {
    fn from(robot: Robot) -> Self {
        Self { robot, notes: Vec::new(), meshes: Vec::new(), hulls: Vec::new(), base: Vec::new() }
    }
}

impl Robot {
    /// Reads a robot from the text of a URDF. On a fixed base the root link is dropped; on a floating base the root
    /// link is link 0. [`UrdfRobot::read`] also gives the assumptions made where the file is silent.
    ///
    /// Limits have no stiffness: URDF does not define one, and nerd-sim's systems add it. Armature is zero. Contact
    /// points come from [`Robot::default_contact_points`].
    ///
    /// # Errors
    /// If the text is refused; the error names the link or joint and the reason.
    pub fn from_urdf(xml: &str, base: Base) -> Result<Self, UrdfError> {
        UrdfRobot::read(xml, base).map(|read| read.robot)
    }
}

impl UrdfRobot {
    /// Like [`Robot::from_urdf`]; also gives the assumptions made where the file is silent.
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
    /// Index of the moving link that carries the hull.
    pub link: usize,
    /// Vertices in that link's frame (m).
    pub vertices: Arc<[Vector3<f64>]>,
    /// Index of the contact properties in the file's table, if the file has one.
    pub surface: Option<usize>,
}

/// A collision mesh named in a robot's file.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// Index of the moving link that carries the mesh.
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
    /// A fault in the text, in a link, in a joint, or in the tree of joints.
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
