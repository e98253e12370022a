//! `[vary]` of a robot's TOML: parameters that differ between environments. [`crate::vary`] draws them.

use super::motors::LATEST;
use crate::internal::*;

/// `[vary]`: ranges of a robot's parameters, drawn once per environment or trajectory. Parameters without a range stay
/// nominal.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct VarySpec {
    /// Factor on the mass and inertia of each link.
    pub mass: Option<Range>,
    /// Additional factor on the inertia of each link about its centre of mass.
    pub inertia: Option<Range>,
    /// Shift of each link's centre of mass along each link axis (m).
    pub com: Option<Range>,
    /// Friction coefficient, of robot and scene alike.
    pub friction: Option<Range>,
    /// Factor on stiffness and damping of contact, of robot and scene alike.
    pub stiffness: Option<Range>,
    /// Additional factor on the damping of contact, which sets the restitution.
    pub contact_damping: Option<Range>,
    /// Magnitude of gravity (m/s^2).
    pub gravity: Option<Range>,
    /// Factor on each joint's kp and kd, of drives and of tasks. In data with random gains (`control.data`), only
    /// trajectories held by drives are affected.
    pub gain: Option<Range>,
    /// Factor on each joint's damping and dry friction.
    pub joint_damping: Option<Range>,
    /// Rotor inertia added at each joint (kg m^2 or kg).
    pub armature: Option<Range>,
    /// Damping added at each joint (N m s/rad or N s/m).
    pub damping: Option<Range>,
    /// Dry friction added at each joint (N m or N).
    pub dry_friction: Option<Range>,
    /// Factor on the torque of each joint. This and the following ranges belong to the actuator and sensor model, which
    /// [`crate::rig`] steps.
    pub strength: Option<Range>,
    /// Delay of torques (frames), 0 to 2.
    pub delay: Option<Range>,
    /// Position of each joint where its sensor reads 0 (rad or m).
    pub zero: Option<Range>,
    /// No-load speed of each joint's motor (rad/s or m/s). The motor's torque falls linearly from
    /// [`super::spec::JointSpec::torque_limit`] at zero velocity to zero at this speed.
    pub top_speed: Option<Range>,
    /// Amplitude of each joint's torque ripple (N m or N). Analytic solvers do not model ripple, and no learned model
    /// is conditioned on ripple.
    pub ripple: Option<Range>,
    /// Standard deviation of white noise on each joint's measured position (rad or m). On measured velocity it is this
    /// value divided by the frame time (s). Recordings ([`crate::trajectories::Trajectories::shown`]) and observations
    /// have noise; stepped states do not.
    pub noise: Option<Range>,
    /// Standard deviation of noise on the measured position of a free root (m).
    pub root_noise: Option<Range>,
    /// Standard deviation of noise on the measured orientation of a free root (rad).
    pub orientation_noise: Option<Range>,
    /// Delay of observations in whole frames, 0 to 2: a drawn number is rounded.
    pub lag: Option<Range>,
    /// Pushes: instantaneous changes of the velocity of a free root (m/s), each in a random horizontal direction.
    /// Episodes only.
    pub push: Option<Range>,
    /// Time from one push to the next (s).
    pub push_every: Option<f64>,
}

/// Bounds of a range that multiplies a nominal value.
const FACTOR: std::ops::RangeInclusive<f64> = 1e-3..=1e3;

impl VarySpec {
    /// Each range with its key, bounds and unit.
    fn ranges(&self) -> [(&'static str, Option<Range>, std::ops::RangeInclusive<f64>, &'static str); 22] {
        [
            ("mass", self.mass, FACTOR, ""),
            ("inertia", self.inertia, FACTOR, ""),
            ("com", self.com, -1e3..=1e3, "m"),
            ("friction", self.friction, 0.0..=1e6, ""),
            ("stiffness", self.stiffness, FACTOR, ""),
            ("contact_damping", self.contact_damping, FACTOR, ""),
            ("gravity", self.gravity, 1e-6..=1e3, "m/s^2"),
            ("gain", self.gain, 0.0..=1e3, ""),
            ("joint_damping", self.joint_damping, 0.0..=1e3, ""),
            ("armature", self.armature, 0.0..=1e6, ""),
            ("damping", self.damping, 0.0..=1e6, ""),
            ("dry_friction", self.dry_friction, 0.0..=1e6, ""),
            ("strength", self.strength, 0.0..=1e3, ""),
            ("delay", self.delay, 0.0..=LATEST, "frames"),
            ("zero", self.zero, -1e3..=1e3, ""),
            ("top_speed", self.top_speed, 1e-3..=1e6, ""),
            ("ripple", self.ripple, 0.0..=1e6, ""),
            ("noise", self.noise, 0.0..=1e3, ""),
            ("root_noise", self.root_noise, 0.0..=1e3, "m"),
            ("orientation_noise", self.orientation_noise, 0.0..=1e3, "rad"),
            ("lag", self.lag, 0.0..=LATEST, "frames"),
            ("push", self.push, 0.0..=1e3, "m/s"),
        ]
    }

    /// The ranges as text.
    pub fn title(&self) -> String {
        let ranges = self
            .ranges()
            .into_iter()
            .filter_map(|(key, range, _, unit)| Some(format!("{key} {} {unit}", range?).trim_end().to_string()));
        ranges.chain(self.push_every.map(|every| format!("push_every {every} s"))).collect::<Vec<_>>().join(", ")
    }

    pub(crate) fn noisy(&self) -> bool {
        [self.noise, self.root_noise, self.orientation_noise].iter().any(Option::is_some)
    }

    /// Whether actuators or sensor zeros differ between robots, which needs [`crate::rig`].
    pub fn rigged(&self) -> bool {
        [self.strength, self.delay, self.zero, self.top_speed, self.ripple].iter().any(Option::is_some)
    }

    pub(crate) fn check(&self, gravity: bool) -> Result<(), String> {
        if self.gravity.is_some() && !gravity {
            return Err("vary.gravity: the robot has no gravity whose size could vary".into());
        }
        match (self.push, self.push_every) {
            (Some(_), None) => return Err("vary.push: say how often, as push_every = 4.0 (s)".into()),
            (None, Some(_)) => return Err("vary.push_every: say how hard, as push = \"U(0, 0.5)\" (m/s)".into()),
            (_, every) => within("vary.push_every", every.unwrap_or(1.0), 1e-6..=1e9, "s")?,
        }
        let mut ranges = self.ranges().into_iter().filter_map(|(key, range, may, unit)| Some((key, range?, may, unit)));
        ranges.try_for_each(|(key, range, may, unit)| law(&format!("vary.{key}"), &range, may, unit))
    }

    pub(crate) fn fits(&self, robot: &Robot) -> Result<(), String> {
        let joints = [
            "gain",
            "joint_damping",
            "armature",
            "damping",
            "dry_friction",
            "strength",
            "delay",
            "zero",
            "top_speed",
            "ripple",
            "noise",
        ];
        let asked = |(key, range, ..): &(&'static str, Option<Range>, _, _)| range.is_some().then_some(*key);
        for key in self.ranges().iter().filter_map(asked) {
            if joints.contains(&key) && robot.joint_count() == 0 {
                return Err(format!("vary.{key}: the robot has no joint"));
            }
            if (key.ends_with("_noise") || key == "push") && !robot.floating() {
                return Err(format!("vary.{key}: the robot's root is not free"));
            }
            if ["friction", "stiffness", "contact_damping"].contains(&key) && robot.contact_points.is_empty() {
                return Err(format!("vary.{key}: the robot has no contact point; give it [[contact]] points"));
            }
        }
        Ok(())
    }
}
