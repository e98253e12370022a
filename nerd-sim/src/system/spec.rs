//! The TOML beside a URDF: everything URDF leaves open. Unknown keys are refused here, numbers out of range in `validate.rs`. Missing keys
//! may come from another file (`merge.rs`). Types are in the order in which [`Spec`] names them.

use serde::Deserializer;

use crate::range::{exactly, number};
use crate::scene::{SceneSpec, is_zero};
use crate::{internal::*, system::vary::VarySpec};

/// A robot's TOML file.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Name of the URDF file, in the folder of this file [default: the name of this file, with .urdf]. Any other file is refused.
    pub urdf: Option<String>,
    /// Whether the root is free.
    pub floating: bool,
    /// One control frame (s), a number or a fraction such as `1/60`.
    #[serde(deserialize_with = "frame_time")]
    pub frame_time: String,
    /// Gravity (m/s^2), world axes.
    #[serde(deserialize_with = "exactly")]
    pub gravity: [f64; 3],
    /// The solver that models of this robot learn from by default.
    #[serde(default)]
    pub truth: Truth,
    /// Substeps of a frame, for the presets `accurate` and `paper`.
    pub substeps: usize,
    /// When preset `paper` computes the mass matrix anew.
    #[serde(default)]
    pub refresh: Refresh,
    /// Names of the state's columns in tables, `q` then `qd` [default: from the joints' names].
    #[serde(default)]
    pub state_columns: Vec<String>,
    /// Names of the torque columns, one for each joint [default: from the joints' names].
    #[serde(default)]
    pub torque_columns: Vec<String>,
    /// Material of the robot, and of scenes without one.
    #[serde(default)]
    pub material: Material,
    /// Random planes in the training data.
    pub random_plane: Option<RandomPlane>,
    /// Scene of the training data [default: `free`].
    pub data_scene: Option<String>,
    /// Random pegs in the training data, on the ground of `data_scene`.
    pub random_pegs: Option<RandomPegs>,
    /// Time (s) from one random torque to the next, drawn once for each trajectory; in between torques follow a smooth curve [default: a
    /// new torque every frame].
    pub smooth: Option<Range>,
    /// Ranges of the robot's numbers that are drawn for each trajectory; see [`crate::vary`].
    pub vary: Option<VarySpec>,
    /// How actions become torques [default: torque = gain times action].
    pub control: Option<ControlSpec>,
    /// Default pose and starts of a floating root.
    pub root: Option<RootSpec>,
    /// By link, the link whose inertia replaces its own in the mass matrix; see [`nerd_core::robot::Robot`].
    #[serde(default)]
    pub mass_matrix_of: BTreeMap<String, String>,
    /// Most contact points of a link's collision meshes; 0 skips meshes.
    #[serde(default = "mesh_points")]
    pub mesh_points: usize,
    /// Whether links of the robot touch each other. Excluded are a link with its parent, and pairs that touch in the default pose.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub self_collision: bool,
    /// Joints.
    #[serde(default, rename = "joint")]
    pub joints: Vec<JointSpec>,
    /// Contact points.
    #[serde(default, rename = "contact")]
    pub contacts: Vec<ContactSpec>,
    /// Named scenes beside `free`.
    #[serde(default, rename = "scene")]
    pub scenes: Vec<SceneSpec>,
}

impl Spec {
    /// One control frame (s); NaN if `frame_time` is not a number.
    pub fn seconds(&self) -> f64 {
        number(&self.frame_time).unwrap_or(f64::NAN)
    }
}

/// How often symplectic Euler computes and factorises the mass matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refresh {
    /// At the first substep of a frame, as the reference does for most robots.
    #[default]
    Frame,
    /// At every substep.
    Substep,
}

/// Random planes, one for each trajectory.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomPlane {
    /// Largest distance of the plane from the root (m).
    pub reach: f64,
    /// Least gap between the start and the plane (m).
    pub clearance: f64,
}

/// Random pegs, drawn for each trajectory.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomPegs {
    /// Number. A peg for which no place clear of the start is found is left out.
    pub count: usize,
    /// Radius (m).
    pub radius: Range,
    /// Height (m).
    pub height: f64,
    /// Position of the foot of each (m), world axes.
    pub at: [Range; 3],
}

/// The position law `tau = kp (target - q) - kd qd`.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// Whether the target is measured from the joint's position, not from its default.
    #[serde(default)]
    pub relative: bool,
    /// Distance of the target for a unit action (rad or m).
    pub scale: f64,
    /// Whether torques are clamped to the joints' gains.
    #[serde(default)]
    pub clamp: bool,
    /// Whether the law uses the state a frame ahead, which keeps stiff gains stable; see [`crate::control::Controller::torques`].
    #[serde(default)]
    pub ahead: bool,
    /// Whether the law acts inside the frame, like a servo's own loop, if the solver has drives ([`crate::drive`]); otherwise `ahead`
    /// applies.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub servo: bool,
    /// Makes training data with this law, under random actions and gains that are drawn every frame.
    pub data: Option<RandomGains>,
}

/// Ranges of gains in training data; all joints have the same.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomGains {
    /// Range of kp.
    pub kp: Range,
    /// Range of kd.
    pub kd: Range,
}

/// Default pose and starts of a floating root.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RootSpec {
    /// Default position (m).
    #[serde(deserialize_with = "exactly")]
    pub position: [f64; 3],
    /// Default orientation, x y z w.
    #[serde(deserialize_with = "exactly")]
    pub quaternion: [f64; 4],
    /// Starts of training data.
    pub sample: RootStart,
    /// Starts of evaluation [default: as for training data].
    pub reset: Option<RootStart>,
}

/// Ranges of a floating root's start.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RootStart {
    /// World position by axis (m).
    #[serde(deserialize_with = "exactly")]
    pub position: [Range; 3],
    /// Angle (rad) by which the default pose is turned, about a cube-uniform axis of the body.
    pub tilt: Range,
    /// Angular velocity in body axes (rad/s).
    #[serde(deserialize_with = "exactly")]
    pub angular: [Range; 3],
    /// Velocity of the root in body axes (m/s).
    #[serde(deserialize_with = "exactly")]
    pub linear: [Range; 3],
    /// Starts are redrawn until all contact points are at least this far from the data's scene (m).
    pub clearance: Option<f64>,
}

/// A joint.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct JointSpec {
    /// Name in the URDF.
    pub name: String,
    /// Name in tables [default: `name`].
    pub column: Option<String>,
    /// Default position (rad or m).
    #[serde(default)]
    pub default: f64,
    /// Inertia of the drive at the joint (kg m^2 or kg).
    #[serde(default)]
    pub armature: f64,
    /// Spring and damper beyond the URDF's limits; with both 0 the joint has no limits.
    ///
    /// Default: stiffness `I (0.2 / dt)^2` and critical damping, where `dt` is the substep of `paper` and I the least inertia of the joint
    /// over a few poses, all others free. Where the URDF's effort would push the joint more than 4 % of its range beyond a limit, the
    /// stiffness is larger, by a factor of 100 at most.
    pub limit: Option<LimitSpec>,
    /// Stiffness of a spring over the whole range (N m/rad or N/m).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub stiffness: f64,
    /// Position at which that spring has no torque (rad or m).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub rest: f64,
    /// Amplitude of random torques (N m or N).
    #[serde(default)]
    pub torque: f64,
    /// Torque of a unit action (N m or N) [default: `torque`].
    pub gain: Option<f64>,
    /// Stiffness of the position law (N m/rad or N/m).
    #[serde(default)]
    pub kp: f64,
    /// Damping of the position law (N m s/rad or N s/m).
    #[serde(default)]
    pub kd: f64,
    /// Starts of training data.
    pub sample: StartSpec,
    /// Starts of evaluation.
    pub reset: StartSpec,
}

impl JointSpec {
    /// Largest torque of its motor (N m or N): the first one known of the torque of a unit action, the effort of the robot's file, and
    /// `kp`.
    pub fn most(&self, joint: &Joint) -> f64 {
        let known = [self.gain.unwrap_or(self.torque), joint.effort, self.kp];
        known.into_iter().find(|x| *x > 0.0 && x.is_finite()).unwrap_or(1.0)
    }
}

/// Spring and damper of a joint limit.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LimitSpec {
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// N m s/rad or N s/m.
    pub damping: f64,
}

/// Ranges of a joint's position and velocity at a start.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct StartSpec {
    /// Range of the position.
    pub q: Range,
    /// Range of the velocity.
    pub qd: Range,
    /// An earlier joint whose position is subtracted from the drawn one.
    pub minus: Option<String>,
}

/// A contact point: a point, a disc or the vertices of a hull ([`nerd_core::contact::Locus`]).
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSpec {
    /// Link it is fixed on.
    pub link: String,
    /// Position from the link's frame as its file has it (m); of a disc its centre.
    #[serde(default, deserialize_with = "given", skip_serializing_if = "Option::is_none")]
    pub point: Option<[f64; 3]>,
    /// Axis of a disc, in that frame.
    #[serde(default, deserialize_with = "given", skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// Radius of a disc (m). It has three contact points.
    pub rim: Option<f64>,
    /// In place of a point: vertices (m, in that frame); the deepest one touches.
    #[serde(default, deserialize_with = "all", skip_serializing_if = "Vec::is_empty")]
    pub vertices: Vec<[f64; 3]>,
    /// Forces begin at this distance (m) [default: 1e-5].
    #[serde(default = "sharp")]
    pub radius: f64,
    /// The contact is masked beyond `max(4 thickness, 0.1)` (m) [default: `radius`].
    pub thickness: Option<f64>,
}

fn sharp() -> f64 {
    1e-5
}

fn given<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f64; 3]>, D::Error> {
    exactly(from).map(Some)
}

fn all<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<[f64; 3]>, D::Error> {
    #[derive(Deserialize)]
    struct Place(#[serde(deserialize_with = "exactly")] [f64; 3]);
    Ok(Vec::<Place>::deserialize(from)?.into_iter().map(|place| place.0).collect())
}

/// A number of seconds, or a fraction as text.
fn frame_time<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "frame_time: a number of seconds is needed, or a fraction such as \"1/60\"")]
    enum Time {
        Number(f64),
        Text(String),
    }
    Ok(match Time::deserialize(from)? {
        Time::Number(seconds) => seconds.to_string(),
        Time::Text(text) => text,
    })
}

/// The corners of a sole or a foot.
pub(crate) fn mesh_points() -> usize {
    8
}
