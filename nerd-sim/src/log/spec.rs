//! The TOML that describes a table of measurements: meaning, unit and frame of its columns.

use nalgebra::{Quaternion, UnitQuaternion};
use serde::{Deserialize, Deserializer, Serialize, de::Error};

/// Description of a table of measurements.
///
/// ```toml
/// about = "MuJoCo, steps of 0.005 s" # origin of the data
/// cost = 60.5                       # computation time (us) of a frame on one core, if a simulator made the data
/// file = "tosses.csv"               # table in the same folder: .csv, .npz or .safetensors; or a folder of tables
/// robot = "cube.urdf"               # file in the same folder, or name of a built-in robot
/// scene = "ground"                  # scene of the measurement [default: ground, or free for a robot without it]
/// only = [0, 2, 3]                  # trajectories to read [default: all]
/// folds = [[0, 3], [2]]             # groups held out together in cross-validation; each trajectory is in one
/// trajectory = "toss"               # column with the trajectory's number [default: all rows are one trajectory]
/// time = "t"                        # column of time [default: one frame per row]
/// units = { length = "m", angle = "rad", time = "s" }   # the defaults; also cm, mm; deg; ms, us, ns
/// [root]                            # of a floating robot
/// position = ["px", "py", "pz"]     # origin of the root link, world axes
/// quaternion = ["qw", "qx", "qy", "qz"]
/// order = "wxyz"                    # order of the four columns above
/// velocity = ["vx", "vy", "vz"]     # of the origin, world axes [default: from differences]
/// ang_vel = ["wx", "wy", "wz"]      # [default: from differences]
/// axes = "body"                     # axes of `ang_vel`: body or world [default: world]
/// [[joint]]                         # one for each joint of the robot
/// name = "hinge"
/// position = "theta"
/// velocity = "thetadot"             # [default: from differences]
/// torque = "tau"                    # from this row to the next [default: 0]; an empty cell (or NaN) ends a trajectory
/// [[published]]                     # published results on these measurements
/// method = "ContactNets"
/// position = 0.017                  # mean distance (m)
/// rotation = 0.242                  # mean angle (rad)
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogSpec {
    pub(super) about: Option<String>,
    pub(super) cost: Option<f64>,
    /// Table, or folder of tables, relative to this file.
    pub file: String,
    pub(super) robot: String,
    pub(super) scene: Option<String>,
    pub(super) only: Option<Vec<u64>>,
    #[serde(default)]
    pub(super) folds: Vec<Vec<u64>>,
    pub(super) trajectory: Option<String>,
    pub(super) time: Option<String>,
    #[serde(default)]
    pub(super) units: Units,
    pub(super) root: Option<RootColumns>,
    #[serde(default, rename = "joint")]
    pub(super) joints: Vec<JointColumns>,
    #[serde(default)]
    pub(super) published: Vec<Published>,
}

/// A published result on the same measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Name of the method.
    pub method: String,
    /// Mean distance of the root positions (m).
    pub position: f64,
    /// Mean angle between the root orientations (rad).
    pub rotation: f64,
}

/// Units as factors to m, rad and s; velocities are in units of length or angle per unit of time.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Units {
    #[serde(deserialize_with = "unit::<_, 0>")]
    pub length: f64,
    #[serde(deserialize_with = "unit::<_, 1>")]
    pub angle: f64,
    #[serde(deserialize_with = "unit::<_, 2>")]
    pub time: f64,
}

impl Default for Units {
    fn default() -> Self {
        Self { length: 1.0, angle: 1.0, time: 1.0 }
    }
}

/// Factors of length, angle and time units, by name.
const UNITS: [&[(&str, f64)]; 3] = [
    &[("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)],
    &[("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)],
    &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)],
];

fn unit<'de, D: Deserializer<'de>, const KIND: usize>(from: D) -> Result<f64, D::Error> {
    let (name, known) = (String::deserialize(from)?, UNITS[KIND]);
    let found = known.iter().find(|(unit, _)| *unit == name).map(|(_, factor)| *factor);
    let names = || known.iter().map(|(unit, _)| *unit).collect::<Vec<_>>().join(", ");
    found.ok_or_else(|| D::Error::custom(format!("unknown unit `{name}`, choose from {}", names())))
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RootColumns {
    pub position: [String; 3],
    pub quaternion: [String; 4],
    pub order: Order,
    pub velocity: Option<[String; 3]>,
    pub ang_vel: Option<[String; 3]>,
    #[serde(default)]
    pub axes: Axes,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Order {
    Wxyz,
    Xyzw,
}

impl Order {
    /// The rotation given by four numbers in this order.
    pub fn turn(self, [a, b, c, d]: [f64; 4]) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(match self {
            Self::Wxyz => Quaternion::new(a, b, c, d),
            Self::Xyzw => Quaternion::new(d, a, b, c),
        })
    }
}

/// Axes of an angular velocity: world, or root link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Axes {
    #[default]
    World,
    Body,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JointColumns {
    pub name: String,
    pub position: String,
    pub velocity: Option<String>,
    pub torque: Option<String>,
}
