//! The TOML beside a URDF: everything that URDF leaves open. Unknown keys are refused here, numbers out of range in
//! `validate.rs`. Missing keys may come from another file (`merge.rs`). Types appear in the order of use in [`Spec`].

use serde::Deserializer;

use crate::range::{exactly, number};
use crate::scene::{SceneSpec, is_zero};
use crate::{internal::*, robots::vary::VarySpec};

/// A robot's TOML file.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Name of the URDF file, in the folder of this file [default: name of this file, with .urdf]. Any other file is
    /// refused.
    pub urdf: Option<String>,
    /// Whether the root link floats with six degrees of freedom; otherwise it is fixed.
    pub floating: bool,
    /// Frame time (s), a number or a fraction such as `1/60`.
    #[serde(deserialize_with = "frame_time")]
    pub frame_time: String,
    /// Gravity (m/s^2), world axes.
    #[serde(deserialize_with = "exactly")]
    pub gravity: [f64; 3],
    /// The solver that models of this robot learn from by default.
    #[serde(default)]
    pub truth: Truth,
    /// Substeps per frame, for the presets `accurate` and `paper`.
    pub substeps: usize,
    /// When preset `paper` recomputes the mass matrix.
    #[serde(default)]
    pub refresh: Refresh,
    /// Column names of the state in tables, `q` then `qd` [default: from joint names].
    #[serde(default)]
    pub state_columns: Vec<String>,
    /// Column names of torques, one per joint [default: from joint names].
    #[serde(default)]
    pub torque_columns: Vec<String>,
    /// Material of the robot, and of scenes without a material.
    #[serde(default)]
    pub material: Material,
    /// Random ground planes of the training data, one per trajectory.
    pub random_plane: Option<RandomPlane>,
    /// Scene of the training data [default: `free`].
    pub data_scene: Option<String>,
    /// Random pegs in the training data, on the ground of `data_scene`.
    pub random_pegs: Option<RandomPegs>,
    /// Time (s) from one random torque to the next, drawn once per trajectory [default: a new torque every frame].
    /// Torques follow a smooth curve in between.
    pub smooth: Option<Range>,
    /// Ranges of parameters drawn for each trajectory; see [`crate::vary`].
    pub vary: Option<VarySpec>,
    /// Conversion of actions to torques [default: torque = gain times action].
    pub control: Option<ControlSpec>,
    /// Default pose and starts of a floating root.
    pub root: Option<RootSpec>,
    /// Names of links, each with the link whose inertia replaces its own in the mass matrix; see
    /// [`nerd_core::robot::Robot`].
    #[serde(default)]
    pub mass_matrix_of: BTreeMap<String, String>,
    /// Maximum number of contact points from a link's collision meshes; 0 skips meshes.
    #[serde(default = "mesh_points")]
    pub mesh_points: usize,
    /// Whether links of the robot collide with each other. Not checked: a link with its parent, and pairs of links that
    /// touch in the default pose.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub self_collision: bool,
    /// Entries `[[joint]]`, one per moving joint.
    #[serde(default, rename = "joint")]
    pub joints: Vec<JointSpec>,
    /// Contact points.
    #[serde(default, rename = "contact")]
    pub contacts: Vec<ContactSpec>,
    /// Named scenes in addition to `free`.
    #[serde(default, rename = "scene")]
    pub scenes: Vec<SceneSpec>,
}

impl Spec {
    /// Frame time (s); NaN if `frame_time` is not a number.
    pub fn seconds(&self) -> f64 {
        number(&self.frame_time).unwrap_or(f64::NAN)
    }
}

/// When symplectic Euler computes and factorises the mass matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refresh {
    /// At the first substep of a frame, as the reference does for most robots.
    #[default]
    Frame,
    /// At every substep.
    Substep,
}

/// Random planes, one per trajectory.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomPlane {
    /// Largest distance of the plane from the first link (m).
    pub reach: f64,
    /// Least distance (m) between the robot at its start and the plane.
    pub clearance: f64,
}

/// Random pegs, drawn for each trajectory.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomPegs {
    /// Number of pegs. A peg is left out if no place clear of the robot's start is found.
    pub count: usize,
    /// Radius (m).
    pub radius: Range,
    /// Height (m).
    pub height: f64,
    /// Position of each peg's foot (m), world axes.
    pub position: [Range; 3],
}

/// The position law `tau = kp (target - q) - kd qd`.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// Whether the target is an offset from the joint's current position instead of from its default position.
    #[serde(default)]
    pub relative: bool,
    /// Displacement of the target per unit action (rad or m).
    pub scale: f64,
    /// Whether each joint's torque is clamped to plus or minus its `gain` (N m or N).
    #[serde(default)]
    pub clamp: bool,
    /// Whether the law uses the predicted state at the end of the frame, which keeps stiff gains stable; see
    /// [`crate::control::Controller::torques`].
    #[serde(default)]
    pub stable_pd: bool,
    /// Whether the law acts inside the frame, like the inner loop of a servo, with solvers that have drives
    /// ([`crate::drive`]). Solvers without drives use the law as `stable_pd` sets it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub servo: bool,
    /// If given, training data uses this law, with random actions and with gains drawn every frame.
    pub data: Option<RandomGains>,
}

/// Ranges of gains in training data, equal for all joints.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomGains {
    /// Range of the stiffness kp (N m/rad or N/m).
    pub kp: Range,
    /// Range of the damping kd (N m s/rad or N s/m).
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
    /// Starts of evaluation [default: `sample`].
    pub reset: Option<RootStart>,
}

/// Ranges of a floating root's start.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RootStart {
    /// World position by axis (m).
    #[serde(deserialize_with = "exactly")]
    pub position: [Range; 3],
    /// Angle (rad) of a rotation of the default pose about a random body axis, drawn uniformly in a cube.
    pub tilt: Range,
    /// Angular velocity in body axes (rad/s).
    #[serde(deserialize_with = "exactly")]
    pub ang_vel: [Range; 3],
    /// Velocity of the root's origin in body axes (m/s).
    #[serde(deserialize_with = "exactly")]
    pub velocity: [Range; 3],
    /// Least distance (m) of all contact points from the training data's scene; closer starts are drawn again.
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
    pub default_q: f64,
    /// Inertia of the drive train, felt at the joint (kg m^2 or kg).
    #[serde(default)]
    pub armature: f64,
    /// Spring and damper that act beyond the URDF's position limits; with both 0 the joint has no limits.
    ///
    /// Default: stiffness `I (0.2 / dt)^2` and critical damping. `dt` is the substep of `paper`; I is the least inertia
    /// felt at the joint over a few poses with all other joints free. The stiffness is larger where the URDF's effort
    /// would push the joint beyond a limit by more than 4 % of the joint's range. The increase is at most a factor of
    /// 100.
    pub limit: Option<LimitSpec>,
    /// Stiffness of a spring over the whole range (N m/rad or N/m).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub stiffness: f64,
    /// Rest position (rad or m) of the spring with `stiffness`.
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
    /// Torque limit (N m or N) of the joint's motor. It is the first positive finite number among the torque of a unit
    /// action, the effort in the robot's file, and `kp`; else 1.
    pub fn torque_limit(&self, joint: &Joint) -> f64 {
        let known = [self.gain.unwrap_or(self.torque), joint.effort, self.kp];
        known.into_iter().find(|x| *x > 0.0 && x.is_finite()).unwrap_or(1.0)
    }
}

/// Spring and damper of a joint limit.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LimitSpec {
    /// Stiffness (N m/rad or N/m).
    pub stiffness: f64,
    /// Damping (N m s/rad or N s/m).
    pub damping: f64,
}

/// Ranges of a joint's position and velocity at a start.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct StartSpec {
    /// Range of the position (rad or m).
    pub q: Range,
    /// Range of the velocity (rad/s or m/s).
    pub qd: Range,
    /// An earlier joint; its position is subtracted from the drawn position.
    pub minus: Option<String>,
}

/// A contact point: a point, a disc, or the vertices of a convex hull ([`nerd_core::contact::Locus`]).
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSpec {
    /// Name of the link.
    pub link: String,
    /// Position in the link frame of the robot's file (m); for a disc its centre.
    #[serde(default, deserialize_with = "given", skip_serializing_if = "Option::is_none")]
    pub point: Option<[f64; 3]>,
    /// Axis of a disc, in the link frame of the robot's file.
    #[serde(default, deserialize_with = "given", skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// Radius of a disc (m). A disc gets three contact points.
    pub rim: Option<f64>,
    /// Vertices of a convex hull (m, link frame of the robot's file), in place of `point`. The deepest vertex is in
    /// contact.
    #[serde(default, deserialize_with = "all", skip_serializing_if = "Vec::is_empty")]
    pub vertices: Vec<[f64; 3]>,
    /// Distance at which contact forces begin (m) [default: 1e-5].
    #[serde(default = "sharp")]
    pub radius: f64,
    /// Distance scale (m) of the contact mask: contacts farther away than `max(4 thickness, 0.1)` are masked [default:
    /// `radius`].
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

/// Frame time: a number of seconds, or a fraction as text.
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

/// Default number of contact points from meshes: the corners of a box-shaped sole or foot.
pub(crate) fn mesh_points() -> usize {
    8
}
