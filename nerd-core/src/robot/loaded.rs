//! A robot as read from a URDF, with what the file leaves open; why one is refused.

use std::sync::Arc;

use crate::prelude::*;

/// What a URDF's text holds.
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfRobot {
    /// The robot.
    pub robot: Robot,
    /// What was taken for granted where the text is silent, a line each.
    pub notes: Vec<String>,
    /// Collision meshes on moving links, which the robot does not use; a caller that can read files may turn them into contact points.
    pub meshes: Vec<MeshFile>,
    /// Those that were read.
    pub hulls: Vec<Hull>,
    /// Collision shapes of a fixed base, in its frame; the robot has none of them.
    pub base: Vec<Shape>,
}

impl From<Robot> for UrdfRobot {
    fn from(robot: Robot) -> Self {
        Self { robot, notes: Vec::new(), meshes: Vec::new(), hulls: Vec::new(), base: Vec::new() }
    }
}

/// The convex hull of a collision mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Index of the moving link that carries it.
    pub link: usize,
    /// Its vertices in that link's frame (m).
    pub vertices: Arc<[Vector3<f64>]>,
}

/// A collision mesh that a URDF names.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// Index of the moving link that carries it.
    pub link: usize,
    /// Name of its link in the URDF.
    pub of: String,
    /// Where it is in the moving link's frame.
    pub pose: Isometry3<f64>,
    /// The file, as the URDF says it.
    pub file: String,
    /// By what its lengths are multiplied, along its own axes.
    pub scale: Vector3<f64>,
}

/// Why a URDF cannot be honoured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UrdfError {
    /// What is wrong with it: the text, a link, a joint, or the tree that they make.
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
