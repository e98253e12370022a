//! The TOML beside a URDF: what URDF cannot say. Unknown keys are refused.

use serde::Deserialize;

use crate::law::Law;
use crate::scene::Material;

/// One file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// URDF file beside this one.
    pub urdf: String,
    /// Whether the root is free.
    pub floating: bool,
    /// One control frame (s), a number or a fraction such as `1/60`.
    pub frame_time: String,
    /// Gravity (m/s^2), world axes.
    pub gravity: [f64; 3],
    /// Substeps of the reference simulator in one frame.
    pub substeps: usize,
    /// Names of the state's columns in tables, `q` then `qd`.
    pub state_columns: Vec<String>,
    /// Names of the torque columns, one a joint.
    pub torque_columns: Vec<String>,
    /// Material of the robot and of scenes made from this file.
    #[serde(default)]
    pub material: Material,
    /// Random planes of the training data, if any.
    pub random_plane: Option<RandomPlane>,
    /// What is said of each joint.
    #[serde(default, rename = "joint")]
    pub joints: Vec<JointSpec>,
    /// Contact points, in order.
    #[serde(default, rename = "contact")]
    pub contacts: Vec<ContactSpec>,
    /// Named scenes beside `free`.
    #[serde(default, rename = "scene")]
    pub scenes: Vec<SceneSpec>,
}

/// What is said of a joint.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointSpec {
    /// Name in the URDF.
    pub name: String,
    /// Drive inertia at the joint (kg m^2 or kg).
    #[serde(default)]
    pub armature: f64,
    /// Spring and damper beyond the URDF's limits.
    pub limit: Option<LimitSpec>,
    /// Amplitude of random torques (N m or N).
    #[serde(default)]
    pub torque: f64,
    /// Initial box of training data.
    pub sample: StartSpec,
    /// Initial box of evaluation.
    pub reset: StartSpec,
}

/// Spring and damper of a limit.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimitSpec {
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// N m s/rad or N s/m.
    pub damping: f64,
}

/// Laws of a joint's initial position and velocity.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartSpec {
    /// Law of the position.
    pub q: Law,
    /// Law of the velocity.
    pub qd: Law,
    /// An earlier joint whose position is subtracted from the draw.
    pub minus: Option<String>,
}

/// A contact point.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSpec {
    /// Link it is fixed on.
    pub link: String,
    /// Position in the link frame (m).
    pub point: [f64; 3],
    /// Radius in the contact law (m).
    pub radius: f64,
    /// Thickness of the mask (m).
    pub thickness: f64,
}

/// Law of random planes (per trajectory).
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RandomPlane {
    /// Farthest the plane stands from the root (m).
    pub reach: f64,
    /// Least gap between the start and the plane (m).
    pub clearance: f64,
}

/// A named scene.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Its name on the command line.
    pub name: String,
    /// Its plane.
    pub plane: PlaneSpec,
}

/// A plane through (0, height, 0): the horizontal one turned by extrinsic x-y-z angles.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneSpec {
    /// Height along the up axis (m).
    pub height: f64,
    /// Angles (rad), `R = Rz Ry Rx`.
    pub angles: [f64; 3],
}
