//! `[cable]` of a TOML, and the default specification of a cable.

use crate::internal::*;
use crate::robots::derive::{between, listed, plain, rounded};
use crate::robots::spec::{RootSpec, RootStart, StartSpec};

/// Maximum number of rods: a dense mass matrix then takes a gigabyte.
const MAX_RODS: f64 = 3000.0;

/// Support of a cable's first end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Support {
    /// A gripper on three slides (x, y, z) and three hinges (yaw, pitch, roll). Each has a critically damped spring
    /// about zero, like an arm under impedance control. A force of `stiffness` times x (N) moves the gripper to x (m).
    #[default]
    Gripper,
    /// A fixed clamp.
    Fixed,
    /// No support.
    Free,
}

/// Data sheet of a cable: `[cable]` in a TOML.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CableSpec {
    /// Length (m).
    pub length: f64,
    /// Outer diameter (m).
    pub diameter: f64,
    /// Total mass (kg).
    pub mass: f64,
    /// Bending stiffness E I (N m^2).
    pub bending: f64,
    /// Torsional stiffness G J (N m^2); without a value the cable does not twist.
    pub twisting: Option<f64>,
    /// Damping of bending: moment per rate of curvature (N m^2 s). Damping of twisting has the same ratio to torsional
    /// stiffness [default: 0.01 s times the stiffness].
    pub damping: Option<f64>,
    /// Number of rods.
    #[serde(default = "forty")]
    pub links: usize,
    /// Support of the first end.
    #[serde(default)]
    pub support: Support,
    /// Position of the first end at zero coordinates (m, world) [default: one cable length above the origin].
    pub position: Option<[f64; 3]>,
    /// Direction from the first end to the other end at zero coordinates.
    #[serde(default = "forward")]
    pub direction: [f64; 3],
}

fn forty() -> usize {
    40
}

fn forward() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

impl CableSpec {
    /// Refuses a cable with a number out of range.
    pub fn check(&self) -> Result<(), String> {
        let within =
            |key: &str, x: f64, low: f64, high: f64, unit: &str| within(format!("[cable] {key}"), x, low..=high, unit);
        within("length", self.length, 1e-3, 1e4, "m")?;
        within("diameter", self.diameter, 1e-6, self.length, "m")?;
        within("mass", self.mass, 1e-9, 1e6, "kg")?;
        within("bending", self.bending, 0.0, 1e9, "N m^2")?;
        within("twisting", self.twisting.unwrap_or(0.0), 0.0, 1e9, "N m^2")?;
        within("damping", self.damping.unwrap_or(0.0), 0.0, 1e9, "N m^2 s")?;
        within("links", self.links as f64, 1.0, MAX_RODS, "")?;
        self.position().iter().try_for_each(|x| within("position", *x, -1e6, 1e6, "m"))?;
        within("direction's size", Vector3::from(self.direction).norm(), 1e-6, 1e6, "")
    }

    pub(super) fn position(&self) -> [f64; 3] {
        self.position.unwrap_or([0.0, 0.0, self.length])
    }

    /// Rotation of the x axis to the cable's direction.
    pub(super) fn turn(&self) -> UnitQuaternion<f64> {
        rotation_from(&Vector3::x_axis(), &self.direction.into())
    }
}

/// Penetration of a resting cable's contacts, as a share of the diameter.
const REST_PENETRATION: f64 = 0.01;
/// Creep velocity (m/s) of a contact under a tangential force of a fifth of a rod's weight.
const CREEP: f64 = 1e-3;
/// Spread (rad) of the far end's direction at starts. Joints are bent independently, unlike a real cable's, and the
/// energy in their springs is released at once, so the spread is small.
const END_SPREAD: f64 = 0.06;
/// Time (s) that a gripper takes to move from one random position to the next.
const GRIPPER_MOVE_TIME: Range = Range { low: 0.3, high: 1.5 };

impl CableSpec {
    /// Default specification of a cable's robot.
    pub(crate) fn spec(&self, robot: &Robot) -> Spec {
        let mut spec = plain(robot);
        let bend = END_SPREAD * (3.0 / self.links as f64).sqrt();
        for (own, joint) in spec.joints.iter_mut().zip(robot.joints()) {
            let reach = match joint.name.as_str() {
                "x" | "y" | "z" => Some(0.3 * self.length),
                "yaw" | "pitch" | "roll" => Some(0.5),
                // Twist starts at zero: no hand would hold random twists.
                name if name.starts_with("twist") => Some(0.0),
                _ => None,
            };
            (own.armature, own.stiffness) = (joint.armature, joint.stiffness);
            // An action of 1 moves the gripper to the end of its range of starts.
            let most = reach.map_or(0.0, |reach| rounded(reach * joint.stiffness));
            (own.torque, own.gain) = (most, Some(most));
            let q = reach.map_or(between(-bend, bend), |reach| between(-reach, reach));
            own.sample = StartSpec { q, ..StartSpec::default() };
            let near = if reach.is_some() { 0.1 } else { 1.0 };
            own.reset = StartSpec { q: Range { low: near * q.low, high: near * q.high }, ..StartSpec::default() };
        }
        let weight = self.mass / self.links as f64 * GRAVITY;
        let stiffness = rounded(weight / (REST_PENETRATION * self.diameter));
        spec.material = Material {
            stiffness,
            damping: rounded((stiffness * weight / GRAVITY).sqrt()),
            friction_damping: rounded(0.2 * weight / CREEP),
            friction: 0.5,
            ..Material::default()
        };
        let touches = !robot.contact_points.is_empty();
        let start = RootStart {
            position: self.position().map(|x| Range { low: x, high: x }),
            clearance: touches.then_some(0.5 * self.diameter),
            ..RootStart::default()
        };
        spec.root = (self.support == Support::Free).then(|| RootSpec {
            position: self.position(),
            quaternion: self.turn().coords.into(),
            sample: start,
            reset: None,
        });
        let smooth = (self.support == Support::Gripper).then_some(GRIPPER_MOVE_TIME);
        Spec { substeps: 8, data_scene: touches.then(|| "plane".into()), smooth, contacts: listed(robot), ..spec }
    }
}
