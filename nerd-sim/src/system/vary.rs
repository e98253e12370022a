//! `[vary]` of a robot's TOML: what differs between environments. [`crate::vary`] draws it.

use crate::internal::*;

/// `[vary]`: ranges from which a robot's numbers are drawn, once an environment or a trajectory. What is not there stays as it is.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct VarySpec {
    /// Factor on the mass of each link, and on its inertia with it.
    pub mass: Option<Range>,
    /// Factor on the inertia of each link about its centre of mass.
    pub inertia: Option<Range>,
    /// Shift of each link's centre of mass along each axis of the link (m).
    pub com: Option<Range>,
    /// Friction coefficient, of robot and scene alike.
    pub friction: Option<Range>,
    /// Factor on the stiffness and the damping of contact, of robot and scene alike.
    pub stiffness: Option<Range>,
    /// Size of gravity (m/s^2).
    pub gravity: Option<Range>,
    /// Factor on each joint's kp and kd, of drives and of tasks. Data whose gains are random (`control.data`) have them where a
    /// trajectory is held, not driven.
    pub gain: Option<Range>,
    /// Factor on each joint's damping and dry friction.
    pub joint_damping: Option<Range>,
    /// Drive inertia added at each joint (kg m^2 or kg).
    pub armature: Option<Range>,
}

/// Farthest that a factor may lead.
const FACTOR: std::ops::RangeInclusive<f64> = 1e-3..=1e3;

impl VarySpec {
    /// The ranges by key, with what they may hold.
    fn ranges(&self) -> [(&'static str, Option<Range>, std::ops::RangeInclusive<f64>, &'static str); 9] {
        [
            ("mass", self.mass, FACTOR, ""),
            ("inertia", self.inertia, FACTOR, ""),
            ("com", self.com, -1e3..=1e3, "m"),
            ("friction", self.friction, 0.0..=1e6, ""),
            ("stiffness", self.stiffness, FACTOR, ""),
            ("gravity", self.gravity, 1e-6..=1e3, "m/s^2"),
            ("gain", self.gain, 0.0..=1e3, ""),
            ("joint_damping", self.joint_damping, 0.0..=1e3, ""),
            ("armature", self.armature, 0.0..=1e6, ""),
        ]
    }

    pub(crate) fn check(&self, gravity: bool) -> Result<(), String> {
        if self.gravity.is_some() && !gravity {
            return Err("vary.gravity: the robot has no gravity whose size could vary".into());
        }
        let mut ranges = self.ranges().into_iter().filter_map(|(key, range, may, unit)| Some((key, range?, may, unit)));
        ranges.try_for_each(|(key, range, may, unit)| law(&format!("vary.{key}"), &range, may, unit))
    }

    pub(crate) fn fits(&self, robot: &Robot) -> Result<(), String> {
        let joints = ["gain", "joint_damping", "armature"];
        let asked = |(key, range, ..): &(&'static str, Option<Range>, _, _)| range.is_some().then_some(*key);
        for key in self.ranges().iter().filter_map(asked) {
            if joints.contains(&key) && robot.joint_count() == 0 {
                return Err(format!("vary.{key}: the robot has no joint"));
            }
            if ["friction", "stiffness"].contains(&key) && robot.contact_points.is_empty() {
                return Err(format!("vary.{key}: the robot has no contact point; give it [[contact]] points"));
            }
        }
        Ok(())
    }
}
