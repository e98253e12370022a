//! Parameters that can be fitted, by name.

use crate::prelude::*;

/// Errors of calibration; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// A parameter is unknown or has no effect.
    #[error("{0}")]
    Parameter(String),
    /// The scene is unknown.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A step of the solver failed.
    #[error(transparent)]
    Step(#[from] StepError),
    /// There is no trial to fit to.
    #[error("no trials to fit to")]
    Empty,
}

impl CalibrateError {
    pub(super) fn idle(name: &str) -> Self {
        Self::Parameter(format!(
            "parameter `{name}` has nothing to act on: no gravity, no mass, or no plane of the scene's own; leave it out"
        ))
    }
}

/// A parameter with name, nominal value and bounds.
///
/// | name | what | unit |
/// |---|---|---|
/// | `mass:LINK` | mass | kg |
/// | `com.x:LINK` (y, z) | centre of mass in the link frame of the robot's file | m |
/// | `inertia:LINK` | factor on the inertia about the centre of mass | 1 |
/// | `spread.x:LINK` (y, z) | factor on the second moment of mass along an axis of this frame | 1 |
/// | `size` | factor on all lengths of the robot: its metre relative to the log's | 1 |
/// | `friction`, `stiffness`, `damping` | contact, robot and scene alike | 1, N/m, N s/m |
/// | `rounding` | radius of corners: contact points move inward and become spheres tangent to the same planes | m |
/// | `restitution` | restitution of rapier's contacts | 1 |
/// | `gravity` | magnitude of gravity | m/s^2 |
/// | `height`, `tilt.x`, `tilt.y` | offset and rotations of the scene's plane from its specification | m, rad |
/// | `lag` | frames by which measured velocities are older than their poses, in free fall | 1 |
/// | `joint-damping:JOINT`, `joint-friction:JOINT` | damping and dry friction of a joint | N m s/rad, N m |
/// | `armature:JOINT` | rotor inertia at a joint | kg m^2 |
/// | `zero:JOINT` | joint position at sensor reading 0: position = reading + zero | rad or m |
/// | `strength:JOINT` | factor on the torque of a joint's motor | 1 |
/// | `delay` | delay of torques in frames | 1 |
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name, as in the table above.
    pub name: String,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Nominal value, which holds without a fit.
    pub nominal: f64,
    /// Whether the parameter is scaled by its logarithm.
    pub logarithmic: bool,
    /// Unit.
    pub unit: &'static str,
    /// Cost of leaving the nominal value: the objective increases by this times the squared distance in scaled
    /// parameters. Default 0.
    pub weight: f64,
    pub(super) what: What,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum What {
    Mass(usize),
    Com(usize, usize),
    Inertia(usize),
    Spread(usize, usize),
    Size,
    Friction,
    Stiffness,
    Damping,
    Rounding,
    Restitution,
    Gravity,
    Height,
    Tilt(usize),
    Lag,
    Delay,
    Zero(usize),
    Strength(usize),
    JointDamping(usize),
    JointFriction(usize),
    Armature(usize),
}

/// Names of the parameters that take no `:LINK` or `:JOINT`.
const PLAIN: &str =
    "friction, stiffness, damping, rounding, size, restitution, gravity, height, lag, delay, tilt.x, tilt.y";

fn unknown(robot: &Robot, name: &str) -> CalibrateError {
    let links = robot.links.iter().map(|l| l.name.as_str()).collect::<Vec<_>>().join(", ");
    let joints = robot.joints().map(|j| j.name.as_str()).collect::<Vec<_>>().join(", ");
    let of_joints =
        if joints.is_empty() { "" } else { "; armature, joint-damping, joint-friction, strength, zero:JOINT of " };
    CalibrateError::Parameter(format!(
        "no parameter `{name}`: choose from {PLAIN}; mass, com.x, com.y, com.z, inertia, spread.x, spread.y, spread.z:LINK of {links}{of_joints}{joints}"
    ))
}

impl Parameter {
    /// The parameter of this name, with bounds from the robot's nominal values and size.
    pub fn named(system: &System, name: &str) -> Result<Self, CalibrateError> {
        let (head, of) = name.split_once(':').map_or((name, None), |(head, of)| (head, Some(of)));
        let plain = PLAIN.split(", ").any(|known| known == head);
        let robot = &system.robot;
        let unknown = || unknown(robot, name);
        let link = || match of {
            Some(of) => robot.link(of).map_err(|_| unknown()),
            None if robot.links.len() == 1 => Ok(0),
            None => Err(unknown()),
        };
        let joint = || of.and_then(|of| robot.joints().enumerate().find(|(_, j)| j.name == of)).ok_or_else(unknown);
        let size = extent(system);
        let m = system.spec.material;
        let g = system.gravity().norm();
        let (what, nominal, low, high, logarithmic, unit) = match head {
            _ if plain && of.is_some() => return Err(unknown()),
            "gravity" | "lag" if g == 0.0 => return Err(CalibrateError::idle(name)),
            "mass" if robot.links[link()?].inertia.mass <= 0.0 => return Err(CalibrateError::idle(name)),
            "mass" => ratio(What::Mass(link()?), robot.links[link()?].inertia.mass, 3.0, "kg"),
            "com.x" | "com.y" | "com.z" => {
                let Link { frame, inertia, .. } = &robot.links[link()?];
                let at = frame.inverse_transform_point(&inertia.com.into())[axis(head)];
                (What::Com(link()?, axis(head)), at, at - 0.2 * size, at + 0.2 * size, false, "m")
            }
            "spread.x" | "spread.y" | "spread.z" => ratio(What::Spread(link()?, axis(head)), 1.0, 3.0, "1"),
            "size" => (What::Size, 1.0, 0.9, 1.1, false, "1"),
            "inertia" => ratio(What::Inertia(link()?), 1.0, 2.0, "1"),
            "friction" => ratio(What::Friction, m.friction.max(1e-3), 4.0, "1"),
            "stiffness" => ratio(What::Stiffness, m.stiffness.max(1.0), 10.0, "N/m"),
            "damping" => ratio(What::Damping, m.damping.max(1e-2), 20.0, "N s/m"),
            "rounding" => (What::Rounding, 0.0, 0.0, 0.1 * size, false, "m"),
            "restitution" => (What::Restitution, 0.0, 0.0, 0.8, false, "1"),
            "gravity" => (What::Gravity, g, 0.9 * g, 1.1 * g, false, "m/s^2"),
            "height" => (What::Height, 0.0, -0.05 * size, 0.05 * size, false, "m"),
            "tilt.x" | "tilt.y" => (What::Tilt(axis(head)), 0.0, -0.05, 0.05, false, "rad"),
            "lag" => (What::Lag, 0.0, -1.0, 1.0, false, "1"),
            "delay" if robot.joint_count() == 0 => return Err(CalibrateError::idle(name)),
            "delay" => (What::Delay, 0.0, 0.0, 1.0, false, "1"),
            "zero" => {
                let (k, own) = joint()?;
                let (most, unit) = if own.kind == JointKind::Prismatic { (0.1 * size, "m") } else { (0.3, "rad") };
                (What::Zero(k), 0.0, -most, most, false, unit)
            }
            "strength" => ratio(What::Strength(joint()?.0), 1.0, 1.5, "1"),
            // Upper bound: damping that stops a tenth of mass x size^2 (kg m^2) within 0.02 s.
            "joint-damping" => joint().map(|(k, j)| {
                braked(What::JointDamping(k), j.damping, 5.0 * size * size * robot.mass(), "N m s/rad")
            })?,
            // Upper bound: friction that holds a tenth of the robot's weight on Earth on a lever of the robot's size.
            "joint-friction" => joint()
                .map(|(k, j)| braked(What::JointFriction(k), j.friction, 0.1 * size * robot.mass() * GRAVITY, "N m"))?,
            // Upper bound: a hundredth of mass x size^2 (kg m^2).
            "armature" => joint()
                .map(|(k, j)| braked(What::Armature(k), j.armature, 0.01 * size * size * robot.mass(), "kg m^2"))?,
            _ => return Err(unknown()),
        };
        Ok(Self { name: name.into(), low, high, nominal, logarithmic, unit, weight: 0.0, what })
    }

    /// Parameters that passive motion in a scene may determine, for `articulated` or `rapier`. Links: centre of mass,
    /// inertia, mass relative to the root's. Scene: contact, magnitude of gravity, lag, tilt of the ground. Robot: size
    /// (in the log's metres, if free), damping and friction of joints.
    pub fn usual(system: &System, scene: &str, rapier: bool) -> Result<Vec<Self>, CalibrateError> {
        let mut names: Vec<String> = Vec::new();
        for (k, link) in system.robot.links.iter().enumerate() {
            let heavy = link.inertia.mass > 0.0;
            let own =
                ["com.x", "com.y", "com.z", "inertia"].into_iter().chain((k > 0).then_some("mass")).filter(|_| heavy);
            names.extend(
                own.map(
                    |head| if system.robot.links.len() == 1 { head.into() } else { format!("{head}:{}", link.name) },
                ),
            );
        }
        let contact: &[&str] =
            if rapier { &["friction", "restitution"] } else { &["friction", "stiffness", "damping", "rounding"] };
        let falls: &[&str] = if system.gravity().norm() > 0.0 { &["gravity", "lag"] } else { &[] };
        let metre: &[&str] = if system.robot.floating() { &["size"] } else { &[] };
        // A built-in scene has no plane of the robot's specification to tilt.
        let own = system.robot.floating() && system.spec.scenes.iter().any(|s| s.name == scene);
        let lies: &[&str] = if own { &["tilt.x", "tilt.y"] } else { &[] };
        names.extend(contact.iter().chain(falls).chain(metre).chain(lies).map(|name| name.to_string()));
        let joints = system.robot.joints().map(|j| j.name.clone());
        // rapier has no dry friction at joints.
        names.extend(
            joints
                .flat_map(|j| [Some(format!("joint-damping:{j}")), (!rapier).then(|| format!("joint-friction:{j}"))])
                .flatten(),
        );
        names.iter().map(|name| Self::named(system, name)).collect()
    }

    /// Additional parameters that torques may determine: armature, zeros of sensors, delay of torques.
    pub fn driven(system: &System) -> Result<Vec<Self>, CalibrateError> {
        let joints = system.robot.joints().flat_map(|j| [format!("armature:{}", j.name), format!("zero:{}", j.name)]);
        joints.chain(["delay".into()]).map(|name| Self::named(system, &name)).collect()
    }

    /// The value at scaled parameter `x`, from 0 (lower bound) to 1 (upper bound).
    pub fn at(&self, x: f64) -> f64 {
        let x = x.clamp(0.0, 1.0);
        if self.logarithmic { self.low * (self.high / self.low).powf(x) } else { self.low + x * (self.high - self.low) }
    }

    /// The parameter with another nominal value and cost of leaving it: see [`Self::weight`].
    #[must_use]
    pub fn near(&self, nominal: f64, weight: f64) -> Self {
        Self { nominal, weight, ..self.clone() }
    }

    /// Cost of a value, and its derivative with respect to the scaled parameter.
    pub(super) fn pull(&self, value: f64) -> [f64; 2] {
        let way = self.place(value) - self.place(self.nominal);
        [self.weight * way * way, 2.0 * self.weight * way]
    }

    /// Derivative of a value with respect to the scaled parameter.
    pub(super) fn by_place(&self, value: f64) -> f64 {
        if self.logarithmic { value * (self.high / self.low).ln() } else { self.high - self.low }
    }

    /// The scaled parameter of a value: its place between the bounds, from 0 to 1.
    pub fn place(&self, value: f64) -> f64 {
        if self.low == self.high {
            return 0.0;
        }
        let x = if self.logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        x.clamp(0.0, 1.0)
    }
}

pub(super) fn pull(parameters: &[Parameter], values: &[f64]) -> f64 {
    parameters.iter().zip(values).map(|(p, v)| p.pull(*v)[0]).sum()
}

fn axis(name: &str) -> usize {
    ["x", "y", "z"].iter().position(|axis| name.ends_with(axis)).unwrap_or_default()
}

/// Kind of parameter, nominal value, lower bound, upper bound, whether scaled by its logarithm, unit.
type Bounded = (What, f64, f64, f64, bool, &'static str);

fn ratio(what: What, nominal: f64, factor: f64, unit: &'static str) -> Bounded {
    (what, nominal, nominal / factor, nominal * factor, true, unit)
}

/// Bounds from 0 to `most`, or to ten times the nominal value if that is larger.
fn braked(what: What, own: f64, most: f64, unit: &'static str) -> Bounded {
    (what, own, 0.0, most.max(10.0 * own), false, unit)
}

/// Size of a robot (m): the largest distance along an axis between two contact points of a link, or 1.
fn extent(system: &System) -> f64 {
    let points = &system.robot.contact_points;
    let apart =
        points.iter().flat_map(|a| points.iter().filter(|b| b.link == a.link).map(|b| (a.local - b.local).abs().max()));
    let size = apart.fold(0.0, f64::max);
    if size > 0.0 { size } else { 1.0 }
}

/// Moves every contact point of the robot inward, so that spheres of `radius` touch the planes that the points touched.
pub(super) fn round(system: &mut System, radius: f64) {
    let points = &mut system.robot.contact_points;
    for link in 0..system.robot.links.len() {
        let own: Vec<_> = points.iter().filter(|p| p.link == link).map(|p| p.local).collect();
        let middle = own.iter().sum::<Vector3<f64>>() / own.len().max(1) as f64;
        let moved = |at: &Vector3<f64>| at - (at - middle).map(|x| x.signum() * radius.min(x.abs()));
        for point in points.iter_mut().filter(|p| p.link == link) {
            match &mut point.locus {
                Locus::Fixed => point.local = moved(&point.local),
                Locus::Rim { axis, radius: rim, .. } => {
                    let out = axis.dot(&(point.local - middle));
                    point.local -= axis.as_ref() * out.signum() * radius.min(out.abs());
                    *rim -= radius.min(*rim);
                }
                Locus::Hull { vertices, .. } => {
                    let round =
                        ContactPoint::hull(point.link, vertices.iter().map(moved).collect::<Vec<_>>(), point.radius);
                    *point = ContactPoint { thickness: point.thickness, surface: point.surface, ..round };
                }
            }
            point.radius += radius;
        }
    }
}
