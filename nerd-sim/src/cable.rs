//! A cable, hose or rope as a robot: a chain of rods, with hinges between them that bend and twist like it.
//!
//! `[cable]` in a TOML says what a data sheet says; all other keys of a robot's TOML may stand beside it. Rods are rigid and of equal length
//! l. Between two of them stand a hinge for each direction of bending and, if it twists, one along the rod, with springs of `E I / l` and
//! `G J / l`. Where its first rod is clamped there is half a rod's give, `2 E I / l`: a cantilever then sags as a beam does.
//!
//! ```
//! use nerd_sim::prelude::*;
//! let toml = "[cable]\nlength = 0.5\ndiameter = 0.006\nmass = 0.03\nbending = 1e-3\nlinks = 10\nheld = \"fixed\"";
//! let system = System::from_toml("lead", toml)?;
//! assert_eq!(system.robot.joint_count(), 20);
//! # Ok::<(), SystemError>(())
//! ```

use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use nerd_core::contact::ContactPoint;
use nerd_core::robot::{Base, Joint, JointKind, Link, Robot};
use nerd_core::spatial::BodyInertia;
use serde::{Deserialize, Serialize};

use crate::bodies::GRAVITY;
use crate::columns::name_columns;
use crate::derive::{between, listed, plain, rounded};
use crate::range::Range;
use crate::scene::Material;
use crate::source::Source;
use crate::spec::{RootSpec, RootStart, Spec, StartSpec};
use crate::system::{System, SystemError};
use crate::validate::{check, within};

/// Most rods: their mass matrix, where one is asked for, takes a gigabyte.
const MOST: f64 = 3000.0;
/// Share of the diameter by which a cable at rest presses its contacts in.
const GIVE: f64 = 0.01;
/// Speed (m/s) at which a contact creeps that a fifth of its weight pushes aside.
const CREEP: f64 = 1e-3;
/// Spread (rad) of the far end's direction at starts. No more: joints are bent independently of each other, as no cable ever is, and what
/// springs hold there is let go at once.
const SPREAD: f64 = 0.06;
/// Seconds in which a gripper goes from one random place to the next.
const PACE: Range = Range { low: 0.3, high: 1.5 };
/// Seconds in which a bent piece comes to rest where no damping is said: leads, hoses and ropes lose a bend in a moment. A chain of springs
/// that loses nothing shakes ever faster.
const REST: f64 = 0.01;
/// Name and text of the cables that come with the crate.
pub(crate) const CABLES: [(&str, &str); 2] =
    [("lead", include_str!("../assets/cables/lead.toml")), ("lead-pegs", include_str!("../assets/cables/lead-pegs.toml"))];
/// Keys of a robot's TOML that mean nothing of a cable, and what stands in their place.
pub(crate) const FOREIGN: [(&str, &str); 4] = [
    ("floating", "a cable's root is decided by [cable] held"),
    ("urdf", "a cable has none, [cable] says all of it"),
    ("mesh_points", "a cable has no meshes"),
    ("like", "a cable is like no other robot"),
];
/// How fast a gripper follows (rad/s): 4 Hz.
const PULSE: f64 = 8.0 * std::f64::consts::PI;

/// What holds a cable's first end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Held {
    /// A gripper on three slides (x, y, z) and three hinges (yaw, pitch, roll), each with a critically damped spring about its home, as an arm
    /// under impedance control has: a force of `stiffness x` leads it to x.
    #[default]
    Gripper,
    /// A clamp that stands still.
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
    /// Damping of bending: moment for a unit of the rate of curvature (N m^2 s); that of twisting is in the same ratio to its stiffness
    /// [default: 0.01 s times the stiffness].
    pub damping: Option<f64>,
    /// Rods that stand for it.
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

impl System {
    /// Names of the cables that come with the crate. Beside [`System::built_in`], they can be named wherever a robot is.
    pub fn cables() -> Vec<&'static str> {
        CABLES.iter().map(|c| c.0).collect()
    }

    /// A cable, from the text of its specification: `[cable]`, and whatever else it says of it.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, SystemError> {
        let wrong = |e: String| SystemError::Spec(name.into(), e.trim().replace('\n', " "));
        let mut own: toml::Table = toml::from_str(text).map_err(|e| wrong(e.to_string()))?;
        let Some(cable) = own.remove("cable") else {
            return Err(wrong("there is no [cable] in it, and of other robots the .urdf is named, not the .toml beside it".into()));
        };
        let cable: CableSpec = cable.try_into().map_err(|e| wrong(format!("[cable]: {e}")))?;
        cable.check().map_err(wrong)?;
        if let Some((key, why)) = FOREIGN.into_iter().find(|(key, _)| own.contains_key(*key)) {
            return Err(wrong(format!("{key}: {why}; leave the line out")));
        }
        let mut robot = cable.robot(name);
        if own.get("contact").and_then(toml::Value::as_array).is_some_and(Vec::is_empty) {
            robot.contact_points.clear();
        }
        let spec = cable.spec(&robot);
        bounded(&robot, &spec).map_err(wrong)?;
        let spec = spec.over(own).map_err(wrong)?;
        Self::new(name, robot, spec, Source::Cable)
    }
}

fn forty() -> usize {
    40
}

fn ahead() -> [f64; 3] {
    [1.0, 0.0, 0.0]
}

/// Refuses numbers of a cable of which each is in its range, and what they make together is not.
fn bounded(robot: &Robot, spec: &Spec) -> Result<(), String> {
    let mut spec = spec.clone();
    name_columns(robot, &mut spec);
    let together = "[cable] length, diameter, mass, bending, twisting and links make together what is beyond any cable";
    check(&spec, robot).map_err(|e| format!("{together}: {e}"))
}

impl CableSpec {
    /// Refuses what is no cable.
    ///
    /// # Errors
    /// The key, its value and what is needed.
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

    fn at(&self) -> [f64; 3] {
        self.at.unwrap_or([0.0, 0.0, self.length])
    }

    /// Turns x into the cable's direction.
    fn turn(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::rotation_between(&Vector3::x(), &Vector3::from(self.along))
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI))
    }

    /// The chain. Its links are called `rod1`, `rod2`, .., its joints `bend1`, `sway1`, `twist1`, ..; those of a gripper `x`, `y`, `z`,
    /// `yaw`, `pitch`, `roll`.
    pub fn robot(&self, name: &str) -> Robot {
        let at = Isometry3::translation(self.at()[0], self.at()[1], self.at()[2]);
        let mut robot = Robot::new(name, if self.held == Held::Free { Base::Floating } else { Base::Fixed(at) });
        let mut parent = (self.held == Held::Gripper).then(|| self.carriage(&mut robot));
        let step = self.length / self.links as f64;
        let (mass, radius) = (self.mass / self.links as f64, 0.5 * self.diameter);
        let across = mass * (3.0 * radius * radius + step * step) / 12.0;
        let rod = BodyInertia {
            mass,
            com: Vector3::x() * (0.5 * step),
            inertia: Matrix3::from_diagonal(&Vector3::new(0.5 * mass * radius * radius, across, across)),
        };
        for k in 0..self.links {
            let name = format!("rod{}", k + 1);
            if k == 0 && self.held == Held::Free {
                robot.links.push(Link { name, parent: None, joint: None, inertia: rod, shapes: Vec::new() });
                parent = Some(0);
            } else {
                let clamped = k == 0;
                let mut origin = if clamped {
                    Isometry3::from_parts(Vector3::zeros().into(), self.turn())
                } else {
                    Isometry3::translation(step, 0.0, 0.0)
                };
                let mut hinges = vec![("sway", Vector3::z_axis(), self.bending), ("bend", Vector3::y_axis(), self.bending)];
                hinges.extend(self.twisting.map(|stiffness| ("twist", Vector3::x_axis(), stiffness)));
                let last = hinges.len() - 1;
                for (i, (word, axis, stiffness)) in hinges.into_iter().enumerate() {
                    let mut joint = Joint::new(format!("{word}{}", k + 1), JointKind::Continuous, origin, axis);
                    joint.stiffness = if clamped { 2.0 } else { 1.0 } * stiffness / step;
                    joint.damping = match self.damping {
                        None => joint.stiffness * REST,
                        Some(damping) if self.bending > 0.0 => joint.stiffness * damping / self.bending,
                        Some(damping) => damping / step,
                    };
                    let (name, inertia) =
                        if i == last { (name.clone(), rod) } else { (format!("{word}{}", k + 1), BodyInertia::default()) };
                    robot.links.push(Link { name, parent, joint: Some(joint), inertia, shapes: Vec::new() });
                    parent = Some(robot.links.len() - 1);
                    origin = Isometry3::identity();
                }
            }
            let end = |x: f64| ContactPoint { link: robot.links.len() - 1, local: Vector3::x() * x, radius, thickness: radius };
            let ends = if k == 0 && self.held == Held::Free { vec![end(0.0), end(step)] } else { vec![end(step)] };
            robot.contact_points.extend(ends);
        }
        robot
    }

    /// Six axes; the last link is the gripper. It weighs as little as a rod: each axis has a drive with an inertia of its own.
    fn carriage(&self, robot: &mut Robot) -> usize {
        let [x, y, z] = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
        let (slide, turn) = (JointKind::Prismatic, JointKind::Continuous);
        let axes = [("x", slide, x), ("y", slide, y), ("z", slide, z), ("yaw", turn, z), ("pitch", turn, y), ("roll", turn, x)];
        for (k, (name, kind, axis)) in axes.into_iter().enumerate() {
            let mut joint = Joint::new(name, kind, Isometry3::identity(), axis);
            (joint.armature, joint.stiffness) = self.drive(kind == slide);
            joint.damping = 2.0 * (joint.armature * joint.stiffness).sqrt();
            let (mass, radius) = (self.mass / self.links as f64, 3.0 * self.diameter);
            let ball = BodyInertia { mass, com: Vector3::zeros(), inertia: Matrix3::identity() * (0.4 * mass * radius * radius) };
            let (name, inertia) = if k < 5 { (format!("axis_{name}"), BodyInertia::default()) } else { ("gripper".into(), ball) };
            robot.links.push(Link { name, parent: k.checked_sub(1), joint: Some(joint), inertia, shapes: Vec::new() });
        }
        5
    }

    /// Inertia and stiffness of an axis of the gripper: the cable sags it by little, and does not hurry it.
    fn drive(&self, slides: bool) -> (f64, f64) {
        let stiffness = if slides { 10.0 * self.mass * PULSE * PULSE } else { 25.0 * self.mass * GRAVITY * self.length };
        (rounded(stiffness / (PULSE * PULSE)), rounded(stiffness))
    }

    /// What a TOML says of such a robot where it says no more.
    pub(crate) fn spec(&self, robot: &Robot) -> Spec {
        let still = between(0.0, 0.0);
        let mut spec = plain(robot);
        let bend = SPREAD * (3.0 / self.links as f64).sqrt();
        for (said, joint) in spec.joints.iter_mut().zip(robot.joints()) {
            let reach = match joint.name.as_str() {
                "x" | "y" | "z" => Some(0.3 * self.length),
                "yaw" | "pitch" | "roll" => Some(0.5),
                // What is twisted at random rings: no hand holds it so.
                name if name.starts_with("twist") => Some(0.0),
                _ => None,
            };
            (said.armature, said.stiffness) = (joint.armature, joint.stiffness);
            // A unit of action leads it as far as its reach.
            let most = reach.map_or(0.0, |reach| rounded(reach * joint.stiffness));
            (said.torque, said.gain) = (most, Some(most));
            let q = reach.map_or(between(-bend, bend), |reach| between(-reach, reach));
            said.sample = StartSpec { q, qd: still, minus: None };
            let near = if reach.is_some() { 0.1 } else { 1.0 };
            said.reset = StartSpec { q: Range { low: near * q.low, high: near * q.high }, qd: still, minus: None };
        }
        let weight = self.mass / self.links as f64 * GRAVITY;
        let stiffness = rounded(weight / (GIVE * self.diameter));
        spec.material = Material {
            stiffness,
            damping: rounded((stiffness * weight / GRAVITY).sqrt()),
            friction_damping: rounded(0.2 * weight / CREEP),
            friction: 0.5,
        };
        let touches = !robot.contact_points.is_empty();
        let start = RootStart {
            position: self.at().map(|x| Range { low: x, high: x }),
            tilt: still,
            angular: [still; 3],
            linear: [still; 3],
            clearance: touches.then_some(0.5 * self.diameter),
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
