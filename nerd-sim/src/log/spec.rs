//! The TOML beside a table of measurements: meaning, unit and frame of its columns.

use nalgebra::{Quaternion, UnitQuaternion};
use serde::{Deserialize, Deserializer, Serialize, de::Error};

/// One file of measurements.
///
/// ```toml
/// about = "MuJoCo, steps of 0.005 s" # where it comes from, in words
/// cost = 60.5                       # time (us) that a frame took on one core, where a simulator made it
/// file = "tosses.csv"               # beside this one: .csv, .npz or .safetensors; or a folder of such tables
/// robot = "cube.urdf"               # beside this one, or a built-in robot's name
/// scene = "ground"                  # where it was measured, by default this one, or `free` where the robot has none
/// only = [0, 2, 3]                  # trajectories to read; without it all
/// folds = [[0, 3], [2]]             # those that are judged together, by what was fitted to the others; each in one of them
/// trajectory = "toss"               # column whose value names the trajectory; without it all rows are one
/// time = "t"                        # without it each row is a frame after the one before
/// units = { length = "m", angle = "rad", time = "s" }   # these by default; also cm, mm; deg; ms, us, ns
/// [root]                            # of a floating robot
/// position = ["px", "py", "pz"]     # the root link's origin, world axes
/// quaternion = ["qw", "qx", "qy", "qz"]
/// order = "wxyz"                    # of the four columns above
/// velocity = ["vx", "vy", "vz"]     # of the origin, world axes; without it from differences
/// angular = ["wx", "wy", "wz"]      # without it from differences
/// axes = "body"                     # of `angular`: body or world, by default the world's
/// [[joint]]                         # one for every joint of the robot
/// name = "hinge"
/// position = "theta"
/// velocity = "thetadot"             # without it from differences
/// torque = "tau"                    # from this row to the next; without it 0. An empty cell (or NaN) ends a trajectory
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
    /// Table beside this file, or a folder of them.
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

/// A published figure on the same measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Method that it was published for.
    pub method: String,
    /// Mean distance of the root (m).
    pub position: f64,
    /// Mean angle of the root (rad).
    pub rotation: f64,
}

/// Units, as factors to metres, radians and seconds; velocities are in units of length or angle over time.
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
    pub angular: Option<[String; 3]>,
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
    /// The rotation with these four numbers, in this order.
    pub fn turn(self, [a, b, c, d]: [f64; 4]) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(match self {
            Self::Wxyz => Quaternion::new(a, b, c, d),
            Self::Xyzw => Quaternion::new(d, a, b, c),
        })
    }
}

/// Axes of an angular velocity: the world's, or the root link's.
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
