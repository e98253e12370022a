//! The TOML beside a URDF: what URDF cannot say. Unknown keys are refused, and so are numbers outside the ranges of `validate.rs`.
//! Missing keys may come from another file: see `merge.rs`.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize};

use crate::range::{Range, exactly, number};
use crate::scene::{Material, SceneSpec};
use crate::system::truth::Truth;
use crate::system::vary::VarySpec;

/// One file.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Name of the URDF file beside this one [default: this one's, as .urdf]; another is refused where files are read.
    pub urdf: Option<String>,
    /// Whether the root is free.
    pub floating: bool,
    /// One control frame (s), a number or a fraction such as `1/60`.
    #[serde(deserialize_with = "time")]
    pub frame_time: String,
    /// Gravity (m/s^2), world axes.
    #[serde(deserialize_with = "exactly")]
    pub gravity: [f64; 3],
    /// What models of this robot learn by default.
    #[serde(default)]
    pub truth: Truth,
    /// Substeps of a frame, of presets `accurate` and `paper` alike.
    pub substeps: usize,
    /// When preset `paper` renews the mass matrix.
    #[serde(default)]
    pub refresh: Refresh,
    /// Names of the state's columns in tables, `q` then `qd`; made from the joints' names if empty.
    #[serde(default)]
    pub state_columns: Vec<String>,
    /// Names of the torque columns, one a joint; made from the joints' names if empty.
    #[serde(default)]
    pub torque_columns: Vec<String>,
    /// Material of the robot, and of scenes that name none.
    #[serde(default)]
    pub material: Material,
    /// Random planes of the training data, if any.
    pub random_plane: Option<RandomPlane>,
    /// Scene of the training data [default: `free`].
    pub data_scene: Option<String>,
    /// Random pegs of the training data, if any, on the ground of `data_scene`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub random_pegs: Option<RandomPegs>,
    /// Seconds from one random torque to the next, drawn once a trajectory, with a smooth curve between them [default: they jump every
    /// frame].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smooth: Option<Range>,
    /// Ranges of numbers that differ from trajectory to trajectory, if any; see [`crate::vary`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vary: Option<VarySpec>,
    /// How actions become torques; without it, torque = gain times action.
    pub control: Option<ControlSpec>,
    /// Default pose and starts of a floating root.
    pub root: Option<RootSpec>,
    /// By link, the link whose inertia moves in its place in the mass matrix; see [`nerd_core::robot::Robot`].
    #[serde(default)]
    pub mass_matrix_of: BTreeMap<String, String>,
    /// Contact points for each collision mesh of a URDF; 0 skips meshes.
    #[serde(default = "mesh_points")]
    pub mesh_points: usize,
    /// The joints.
    #[serde(default, rename = "joint")]
    pub joints: Vec<JointSpec>,
    /// Contact points, in order.
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

/// How often the mass matrix is computed and factorised under symplectic Euler.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refresh {
    /// At the first substep of a frame, as the reference simulator does for most robots.
    #[default]
    Frame,
    /// At every substep.
    Substep,
}

/// A joint.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct JointSpec {
    /// Name in the URDF.
    pub name: String,
    /// Name in tables [default: the name].
    pub column: Option<String>,
    /// Default position (rad or m).
    #[serde(default)]
    pub default: f64,
    /// Drive inertia at the joint (kg m^2 or kg).
    #[serde(default)]
    pub armature: f64,
    /// Spring and damper beyond the URDF's limits; both 0 leave them without effect.
    ///
    /// Default: with `paper`'s substep `dt` and the least inertia I that the joint shows over a few poses, all others free,
    /// stiffness `I (0.2 / dt)^2`, or up to a hundred times that where the joint's effort would else push it 4 % of its range
    /// beyond an end; critically damped.
    pub limit: Option<LimitSpec>,
    /// Stiffness of a spring that is always there (N m/rad or N/m).
    #[serde(default, skip_serializing_if = "none")]
    pub stiffness: f64,
    /// Where it rests (rad or m).
    #[serde(default, skip_serializing_if = "none")]
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
    /// Initial box of training data.
    pub sample: StartSpec,
    /// Initial box of evaluation.
    pub reset: StartSpec,
}

/// The position law `tau = kp (target - q) - kd qd`.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// Whether the target is measured from where the joint is, not from its default.
    #[serde(default)]
    pub relative: bool,
    /// Target's distance at a unit action (rad or m).
    pub scale: f64,
    /// Whether torques are kept within the joints' gains.
    #[serde(default)]
    pub clamp: bool,
    /// Whether the law looks a frame ahead, which keeps stiff gains stable; see [`crate::control::Controller::torques`].
    #[serde(default)]
    pub ahead: bool,
    /// If given, training data are driven by this law with random actions and these gains, fresh every frame.
    pub data: Option<RandomGains>,
}

/// Laws of the gains of training data, one draw for all joints.
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
    /// Starts of evaluation [default: those of training data].
    pub reset: Option<RootStart>,
}

/// Laws of a floating root's start.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RootStart {
    /// World position by axis (m).
    #[serde(deserialize_with = "exactly")]
    pub position: [Range; 3],
    /// Angle (rad) of a turn of the default pose about a cube-uniform body axis.
    pub tilt: Range,
    /// Angular velocity in body axes (rad/s).
    #[serde(deserialize_with = "exactly")]
    pub angular: [Range; 3],
    /// Velocity of the root in body axes (m/s).
    #[serde(deserialize_with = "exactly")]
    pub linear: [Range; 3],
    /// Starts are redrawn until every contact point is this far from the data's scene (m).
    pub clearance: Option<f64>,
}

/// Spring and damper of a limit.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LimitSpec {
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// N m s/rad or N s/m.
    pub damping: f64,
}

/// Laws of a joint's initial position and velocity.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct StartSpec {
    /// Range of the position.
    pub q: Range,
    /// Range of the velocity.
    pub qd: Range,
    /// An earlier joint whose position is subtracted from the draw.
    pub minus: Option<String>,
}

/// A contact point.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSpec {
    /// Link it is fixed on.
    pub link: String,
    /// Position in the link frame (m).
    #[serde(deserialize_with = "exactly")]
    pub point: [f64; 3],
    /// Radius in the contact law (m).
    pub radius: f64,
    /// Thickness of the mask (m).
    pub thickness: f64,
}

/// Range of random planes (per trajectory).
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomPlane {
    /// Largest distance of the plane from the root (m).
    pub reach: f64,
    /// Least gap between the start and the plane (m).
    pub clearance: f64,
}

/// Ranges of random pegs (per trajectory).
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RandomPegs {
    /// Their number. One that finds no place clear of the start is left out.
    pub count: usize,
    /// Radius (m).
    pub radius: Range,
    /// Height (m).
    pub height: f64,
    /// Position of each one's foot (m), world axes.
    pub at: [Range; 3],
}

/// A number, or a fraction as text.
fn time<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
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

/// Whether there is nothing to say.
fn none(x: &f64) -> bool {
    *x == 0.0
}

/// The corners of a sole or a foot.
pub(crate) fn mesh_points() -> usize {
    8
}
