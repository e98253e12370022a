//! The TOML beside a table of measurements: which column is what, in which unit and frame.

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

/// One file of measurements.
///
/// ```toml
/// file = "tosses.csv"               # beside this one
/// robot = "cube.urdf"               # beside this one, or a built-in robot's name
/// trajectory = "toss"               # column whose value names the trajectory; without it all rows are one
/// time = "t"
/// units = { length = "m", angle = "rad", time = "s" }
/// [root]                            # of a floating robot
/// position = ["px", "py", "pz"]     # the root link's origin, world axes
/// quaternion = ["qw", "qx", "qy", "qz"]
/// order = "wxyz"                    # of the four columns above
/// velocity = ["vx", "vy", "vz"]     # of the origin, world axes; without it from differences
/// angular = ["wx", "wy", "wz"]      # without it from differences
/// axes = "body"                     # of `angular`: body or world
/// [[joint]]                         # one for every joint of the robot
/// name = "hinge"
/// position = "theta"
/// velocity = "thetadot"             # without it from differences
/// torque = "tau"                    # without it 0
/// [[published]]                     # published results on these measurements
/// method = "ContactNets"
/// position = 0.017                  # mean distance (m)
/// rotation = 0.242                  # mean angle (rad)
/// ```
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogSpec {
    /// CSV beside this file.
    pub file: String,
    /// URDF beside this file, or a built-in robot's name.
    pub robot: String,
    /// Scene in which it was measured.
    #[serde(default = "ground")]
    pub scene: String,
    /// Column that names a row's trajectory.
    #[serde(default)]
    pub trajectory: Option<String>,
    /// Column of time.
    pub time: String,
    /// Units of all columns.
    #[serde(default)]
    pub units: Units,
    /// Columns of a floating root.
    #[serde(default)]
    pub root: Option<RootColumns>,
    /// Columns of joints.
    #[serde(default, rename = "joint")]
    pub joints: Vec<JointColumns>,
    /// What others published.
    #[serde(default)]
    pub published: Vec<Published>,
}

/// A figure that others published of the same measurements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Whose.
    pub method: String,
    /// Mean distance of the root (m).
    pub position: f64,
    /// Mean angle of the root (rad).
    pub rotation: f64,
}

fn ground() -> String {
    "ground".into()
}

/// Units, as factors to metres, radians and seconds; velocities are in those of length or angle over seconds.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Units {
    /// Of lengths: `m` (default), `cm` or `mm`.
    #[serde(deserialize_with = "length")]
    pub length: f64,
    /// Of angles: `rad` (default) or `deg`.
    #[serde(deserialize_with = "angle")]
    pub angle: f64,
    /// Of the column of time: `s` (default), `ms`, `us` or `ns`.
    #[serde(deserialize_with = "time")]
    pub time: f64,
}

impl Default for Units {
    fn default() -> Self {
        Self { length: 1.0, angle: 1.0, time: 1.0 }
    }
}

fn unit<'de, D: Deserializer<'de>>(from: D, known: &[(&str, f64)]) -> Result<f64, D::Error> {
    let name = String::deserialize(from)?;
    let found = known.iter().find(|(unit, _)| *unit == name).map(|(_, factor)| *factor);
    let names = || known.iter().map(|(unit, _)| *unit).collect::<Vec<_>>().join(", ");
    found.ok_or_else(|| D::Error::custom(format!("unknown unit `{name}`, choose from {}", names())))
}

fn length<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    unit(from, &[("m", 1.0), ("cm", 1e-2), ("mm", 1e-3)])
}

fn angle<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    unit(from, &[("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)])
}

fn time<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    unit(from, &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
}

/// Columns of a floating root.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RootColumns {
    /// Position of its origin, world axes.
    pub position: [String; 3],
    /// Its orientation, body to world.
    pub quaternion: [String; 4],
    /// Which of the four is the real part.
    pub order: Order,
    /// Velocity of its origin, world axes.
    #[serde(default)]
    pub velocity: Option<[String; 3]>,
    /// Angular velocity.
    #[serde(default)]
    pub angular: Option<[String; 3]>,
    /// Axes of the angular velocity.
    #[serde(default)]
    pub axes: Axes,
}

/// Order of a quaternion's four numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// The real part first.
    Wxyz,
    /// The real part last.
    Xyzw,
}

/// Axes of an angular velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axes {
    /// The world's.
    #[default]
    World,
    /// The root link's.
    Body,
}

/// Columns of a joint.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointColumns {
    /// Name in the URDF.
    pub name: String,
    /// Its position.
    pub position: String,
    /// Its velocity.
    #[serde(default)]
    pub velocity: Option<String>,
    /// Its torque.
    #[serde(default)]
    pub torque: Option<String>,
}
