//! Scenes in a robot's TOML.

use serde::{Deserialize, Serialize};

use super::material::Material;
use crate::range::exactly;

/// A named scene.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Its name on the command line.
    pub name: String,
    /// Its plane.
    pub plane: PlaneSpec,
    /// Boxes on it.
    #[serde(default, rename = "box", skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<BoxSpec>,
    /// Pegs on it: upright cylinders.
    #[serde(default, rename = "peg", skip_serializing_if = "Vec::is_empty")]
    pub pegs: Vec<PegSpec>,
    /// Its material [default: the robot's].
    pub material: Option<Material>,
}

/// A box, its third edge along the up axis.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BoxSpec {
    /// Its edges (m).
    #[serde(deserialize_with = "exactly")]
    pub size: [f64; 3],
    /// Its centre (m), world axes.
    #[serde(deserialize_with = "exactly")]
    pub at: [f64; 3],
    /// Turn about the up axis (rad).
    #[serde(default)]
    pub turn: f64,
}

/// A cylinder along the up axis.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PegSpec {
    /// Its radius (m).
    pub radius: f64,
    /// Its height (m).
    pub height: f64,
    /// The middle of its foot (m), world axes.
    #[serde(deserialize_with = "exactly")]
    pub at: [f64; 3],
}

/// A plane through (0, height, 0): the horizontal one turned by extrinsic x-y-z angles.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// Height along the up axis (m).
    pub height: f64,
    /// Angles (rad), `R = Rz Ry Rx`.
    #[serde(deserialize_with = "exactly")]
    pub angles: [f64; 3],
}
