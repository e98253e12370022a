//! `[cable]` of a TOML, and defaults where there is nothing else in it.

use crate::internal::*;
use crate::system::derive::{between, listed, plain, rounded};
use crate::system::spec::{RootSpec, RootStart, StartSpec};

/// Most rods: their mass matrix, where one is asked for, takes a gigabyte.
const MOST: f64 = 3000.0;

/// What holds a cable's first end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Held {
    /// A gripper on three slides (x, y, z) and three hinges (yaw, pitch, roll), each with a critically damped spring about its home, as
    /// an arm under impedance control has: a force of `stiffness x` leads it to x.
    #[default]
    Gripper,
    /// A fixed clamp.
    Fixed,
    /// Nothing.
    Free,
}

/// `[cable]`.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CableSpec {
    /// Length (m).
    pub length: f64,
    /// Outer diameter (m).
    pub diameter: f64,
    /// Mass of all of it (kg).
    pub mass: f64,
    /// Bending stiffness E I (N m^2).
    pub bending: f64,
    /// Twisting stiffness G J (N m^2); without it, it does not twist.
    pub twisting: Option<f64>,
    /// Damping of bending: moment per unit rate of curvature (N m^2 s); the damping of twisting has the same ratio to its stiffness
    /// [default: 0.01 s times the stiffness].
    pub damping: Option<f64>,
    /// Number of rods.
    #[serde(default = "forty")]
    pub links: usize,
    /// What holds its first end.
    #[serde(default)]
    pub held: Held,
    /// Where the first end is at zero coordinates (m, world) [default: one length above the origin].
    pub at: Option<[f64; 3]>,
    /// Direction from there to the other end at zero coordinates.
    #[serde(default = "ahead")]
    pub along: [f64; 3],
}

fn forty() -> usize {
    40
}

fn ahead() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

impl CableSpec {
    /// Refuses an impossible cable.
    pub fn check(&self) -> Result<(), String> {
        let within = |key: &str, x: f64, low: f64, high: f64, unit: &str| within(format!("[cable] {key}"), x, low..=high, unit);
        within("length", self.length, 1e-3, 1e4, "m")?;
        within("diameter", self.diameter, 1e-6, self.length, "m")?;
        within("mass", self.mass, 1e-9, 1e6, "kg")?;
        within("bending", self.bending, 0.0, 1e9, "N m^2")?;
        within("twisting", self.twisting.unwrap_or(0.0), 0.0, 1e9, "N m^2")?;
        within("damping", self.damping.unwrap_or(0.0), 0.0, 1e9, "N m^2 s")?;
        within("links", self.links as f64, 1.0, MOST, "")?;
        self.at().iter().try_for_each(|x| within("at", *x, -1e6, 1e6, "m"))?;
        within("along's size", Vector3::from(self.along).norm(), 1e-6, 1e6, "")
    }

    pub(super) fn at(&self) -> [f64; 3] {
        self.at.unwrap_or([0.0, 0.0, self.length])
    }

    /// Turns x into the cable's direction.
    pub(super) fn turn(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::rotation_between(&Vector3::x(), &Vector3::from(self.along))
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI))
    }
}

/// Depth of contacts of a cable at rest, as a share of the diameter.
const GIVE: f64 = 0.01;
/// Speed (m/s) at which a contact creeps under a tangential force of a fifth of its weight.
const CREEP: f64 = 1e-3;
/// Spread (rad) of the far end's direction at starts. No more: joints are bent independently of each other, as in no real cable, and the
/// energy of their springs is released at once.
/// springs hold there is let go at once.
const SPREAD: f64 = 0.06;
/// Seconds in which a gripper goes from one random place to the next.
const PACE: Range = Range { low: 0.3, high: 1.5 };

impl CableSpec {
    /// Default specification of such a robot.
    pub(crate) fn spec(&self, robot: &Robot) -> Spec {
        let mut spec = plain(robot);
        let bend = SPREAD * (3.0 / self.links as f64).sqrt();
        for (own, joint) in spec.joints.iter_mut().zip(robot.joints()) {
            let reach = match joint.name.as_str() {
                "x" | "y" | "z" => Some(0.3 * self.length),
                "yaw" | "pitch" | "roll" => Some(0.5),
                // Twisting starts at zero: no hand would hold random twists.
                name if name.starts_with("twist") => Some(0.0),
                _ => None,
            };
            (own.armature, own.stiffness) = (joint.armature, joint.stiffness);
            // An action of 1 moves it as far as its reach.
            let most = reach.map_or(0.0, |reach| rounded(reach * joint.stiffness));
            (own.torque, own.gain) = (most, Some(most));
            let q = reach.map_or(between(-bend, bend), |reach| between(-reach, reach));
            own.sample = StartSpec { q, ..StartSpec::default() };
            let near = if reach.is_some() { 0.1 } else { 1.0 };
            own.reset = StartSpec { q: Range { low: near * q.low, high: near * q.high }, ..StartSpec::default() };
        }
        let weight = self.mass / self.links as f64 * GRAVITY;
        let stiffness = rounded(weight / (GIVE * self.diameter));
        spec.material = Material {
            stiffness,
            damping: rounded((stiffness * weight / GRAVITY).sqrt()),
            friction_damping: rounded(0.2 * weight / CREEP),
            friction: 0.5,
            ..Material::default()
        };
        let touches = !robot.contact_points.is_empty();
        let start = RootStart {
            position: self.at().map(|x| Range { low: x, high: x }),
            clearance: touches.then_some(0.5 * self.diameter),
            ..RootStart::default()
        };
        spec.root = (self.held == Held::Free).then(|| RootSpec {
            position: self.at(),
            quaternion: self.turn().coords.into(),
            sample: start,
            reset: None,
        });
        let smooth = (self.held == Held::Gripper).then_some(PACE);
        Spec { substeps: 8, data_scene: touches.then(|| "plane".into()), smooth, contacts: listed(robot), ..spec }
    }
}
