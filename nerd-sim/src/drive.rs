//! Drives: position and velocity laws at the joints that act inside the substeps of a solver, as a servo's own loop does.
//!
//! [`crate::control::Controller`] computes a torque once a frame and holds it, which is unstable for stiff gains (`kp > 4 I / h^2`). A
//! drive acts in every substep, so any gain is stable.
//!
//! ```
//! use nerd_sim::drive::Drive;
//! use nerd_sim::prelude::*;
//! let system = System::named("pendulum")?;
//! let mut batch = Batch::new(&system, &system.scene("free")?, 1);
//! // Far stiffer than a torque held over a frame may be.
//! batch.drives = vec![Drive { kp: 1e7, kd: 1e6, target: 0.5, ..Drive::default() }; system.robot.joint_count()];
//! let mut simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)));
//! for _ in 0..120 {
//!     simulation.step(&[0.0, 0.0])?;
//! }
//! assert!((simulation.batch.state(0)[0] - 0.5).abs() < 0.01, "{:?}", simulation.batch.state(0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::scene::{points, up};
use crate::{internal::*, system::stiffness};

/// `tau = kp (target - q) + kd (speed - qd)`, kept within the effort. Beyond the joint's largest velocity
/// ([`nerd_core::robot::Joint::velocity`]) it does not drive the joint faster still.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drive {
    /// Stiffness (N m/rad or N/m).
    pub kp: f64,
    /// Damping (N m s/rad or N s/m).
    pub kd: f64,
    /// Position (rad or m); on a joint without limits a whole turn more is another one.
    pub target: f64,
    /// Velocity (rad/s or m/s).
    pub speed: f64,
    /// Largest torque (N m) or force (N); infinite: none.
    pub effort: f64,
}

impl Default for Drive {
    fn default() -> Self {
        Self { kp: 0.0, kd: 0.0, target: 0.0, speed: 0.0, effort: f64::INFINITY }
    }
}

impl Drive {
    /// Torques that it may have at a velocity: least and largest.
    pub fn bounds(&self, joint: &Joint, qd: f64) -> [f64; 2] {
        let most = |beyond: bool| if beyond { 0.0 } else { self.effort };
        [-most(qd < -joint.velocity), most(qd > joint.velocity)]
    }

    pub(crate) fn check(&self) -> Result<(), String> {
        within("a drive's kp", self.kp, 0.0..=1e9, "")?;
        within("a drive's kd", self.kd, 0.0..=1e9, "")?;
        within("a drive's target", self.target, -1e6..=1e6, "")?;
        within("a drive's speed", self.speed, -1e6..=1e6, "")?;
        within("a drive's effort", self.effort, 0.0..=f64::INFINITY, "")
    }
}

/// Drives that hold a robot's joints where they are in `state`, one a joint: what a URDF asks for that says nothing of gains.
///
/// With the robot's mass m and its extent L (m), from its lowest contact point to its highest, `kp = m g L` holds its weight at the end
/// of a lever as long as itself with an error of a radian (a slide bears it at a twentieth of L, `kp = 20 m g / L`): a legged robot on
/// two or four of them stands. Damping takes a twentieth of a second, `kd = kp / 20`. Efforts are the URDF's. Without gravity it is held
/// as strongly as on Earth.
pub fn holding(system: &System, state: &[f64]) -> Vec<Drive> {
    let robot = &system.robot;
    let (up, points) = (up(&system.gravity()), points(robot, state));
    let [low, high] = points.iter().map(|p| up.dot(p)).fold([f64::INFINITY, -f64::INFINITY], |[low, high], h| [low.min(h), high.max(h)]);
    let extent = if high > low { high - low } else { 1.0 };
    let gravity = system.gravity().norm();
    let weight = robot.mass() * if gravity > 0.0 { gravity } else { GRAVITY };
    let kp = |joint: &Joint| stiffness(weight, extent, joint.kind == JointKind::Prismatic);
    let joints = robot.joints().zip(&state[robot.root_coords()..]);
    joints.map(|(joint, q)| Drive { kp: kp(joint), kd: kp(joint) / 20.0, target: *q, speed: 0.0, effort: joint.effort }).collect()
}

/// Drives with the gains of a robot's specification (`kp`, `kd`), one a joint, at its default position; none if it has no gains.
pub fn specified(system: &System) -> Vec<Drive> {
    let joints = system.joint_specs().zip(system.robot.joints());
    let drives = joints.map(|(s, joint)| Drive { kp: s.kp, kd: s.kd, target: s.default, speed: 0.0, effort: joint.effort });
    if system.joint_specs().any(|s| s.kp > 0.0 || s.kd > 0.0) { drives.collect() } else { Vec::new() }
}

/// The position laws of a robot's specification as drives inside a frame that begins at `state`, where they ask for the torques `tau`, without bounds:
/// one a joint, and in `rest` the torques of joints without gains, which are held.
pub(crate) fn servos(system: &System, state: &[f64], tau: &[f64], drives: &mut Vec<Drive>, rest: &mut Vec<f64>) {
    let robot = &system.robot;
    let (q, qd) = (&state[robot.root_coords()..], &state[robot.nq() + robot.root_dofs()..]);
    drives.clear();
    rest.clear();
    for (i, spec) in system.joint_specs().enumerate() {
        let drive = Drive { kp: spec.kp, kd: spec.kd, effort: system.most(i), ..Drive::default() };
        let (drive, held) = match (spec.kp > 0.0, spec.kd > 0.0) {
            (true, _) => (Drive { target: q[i] + (tau[i] + spec.kd * qd[i]) / spec.kp, ..drive }, 0.0),
            (_, true) => (Drive { speed: qd[i] + tau[i] / spec.kd, ..drive }, 0.0),
            _ => (drive, tau[i]),
        };
        drives.push(drive);
        rest.push(held);
    }
}

/// Takes gradients `by` `[joint][target, speed]` of [`servos`] to those by the torques, added to what is held, and by the state in its tangent space.
pub(crate) fn servos_back(system: &System, by: &[[f64; 2]], by_state: &mut [f64], by_tau: &mut [f64]) {
    let (nv, dofs) = (system.robot.nv(), system.robot.root_dofs());
    for (i, (spec, [target, speed])) in system.joint_specs().zip(by).enumerate() {
        if spec.kp > 0.0 {
            by_tau[i] = target / spec.kp;
            by_state[dofs + i] += target;
            by_state[nv + dofs + i] += target * spec.kd / spec.kp;
        } else if spec.kd > 0.0 {
            by_tau[i] = speed / spec.kd;
            by_state[nv + dofs + i] += speed;
        }
    }
}
