//! Drives: position and velocity laws at the joints that act inside the substeps of a solver, like the inner loop of a
//! servo.
//!
//! [`crate::control::Controller`] holds a torque constant over a frame, which is unstable for stiff gains
//! (`kp > 4 I / h^2`). A drive acts in every substep, so any gain is stable.
//!
//! ```
//! use nerd_sim::drive::Drive;
//! use nerd_sim::prelude::*;
//! let system = System::named("pendulum")?;
//! let mut batch = Batch::new(&system, &system.scene("free")?, 1);
//! // These gains would be unstable as a torque held constant over a frame.
//! batch.drives = vec![Drive { kp: 1e7, kd: 1e6, target: 0.5, ..Drive::default() }; system.robot.joint_count()];
//! let mut simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)));
//! for _ in 0..120 {
//!     simulation.step(&[0.0, 0.0])?;
//! }
//! assert!((simulation.batch.state(0)[0] - 0.5).abs() < 0.01, "{:?}", simulation.batch.state(0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::scene::{points, up};
use crate::{internal::*, robots::derive::stiffness};

/// `tau = kp (target - q) + kd (speed - qd)`, limited to the effort. Beyond the joint's velocity limit
/// ([`nerd_core::robot::Joint::velocity`]) the drive does not accelerate the joint further.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drive {
    /// Stiffness (N m/rad or N/m).
    pub kp: f64,
    /// Damping (N m s/rad or N s/m).
    pub kd: f64,
    /// Target position (rad or m). On a joint without limits, targets a whole turn apart are different targets.
    pub target: f64,
    /// Target velocity (rad/s or m/s).
    pub speed: f64,
    /// Torque limit (N m) or force limit (N); infinite: none.
    pub effort: f64,
}

impl Default for Drive {
    fn default() -> Self {
        Self { kp: 0.0, kd: 0.0, target: 0.0, speed: 0.0, effort: f64::INFINITY }
    }
}

impl Drive {
    /// Least and largest torque (N m or N) of the drive at joint velocity `qd` (rad/s or m/s).
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

/// Drives that hold the joints of a robot at their positions in `state`, one per joint. These drives serve robots whose
/// URDF states no gains.
///
/// The robot has mass m (kg) and extent L (m) from lowest to highest contact point. Then `kp = m g L` on hinges,
/// `kp = 20 m g / L` on slides, and `kd = kp / 20`. A hinge then carries the robot's weight on a lever of length L with
/// an error of 1 rad. For a slide the error is L / 20. Legged robots stand with these gains. Torque limits are the
/// efforts of the URDF. Without gravity, g is Earth's.
pub fn holding(system: &System, state: &[f64]) -> Vec<Drive> {
    let robot = &system.robot;
    let up = up(&system.gravity());
    let points = points(robot, state);
    let [low, high] = points
        .iter()
        .map(|p| up.dot(p))
        .fold([f64::INFINITY, -f64::INFINITY], |[low, high], h| [low.min(h), high.max(h)]);
    let extent = if high > low { high - low } else { 1.0 };
    let gravity = system.gravity().norm();
    let weight = robot.mass() * if gravity > 0.0 { gravity } else { GRAVITY };
    let kp = |joint: &Joint| stiffness(weight, extent, joint.kind == JointKind::Prismatic);
    let joints = robot.joints().zip(&state[robot.root_coords()..]);
    joints
        .map(|(joint, q)| Drive { kp: kp(joint), kd: kp(joint) / 20.0, target: *q, speed: 0.0, effort: joint.effort })
        .collect()
}

/// Drives with the gains `kp` and `kd` of a robot's specification at its default pose, one per joint; empty without
/// gains.
pub fn specified(system: &System) -> Vec<Drive> {
    let joints = system.joint_specs().zip(system.robot.joints());
    let drives =
        joints.map(|(s, joint)| Drive { kp: s.kp, kd: s.kd, target: s.default_q, speed: 0.0, effort: joint.effort });
    if system.joint_specs().any(|s| s.kp > 0.0 || s.kd > 0.0) { drives.collect() } else { Vec::new() }
}

/// Converts the position laws of a specification to drives, one per joint. The frame starts at `state` with the laws'
/// unlimited torques `tau`. `rest` receives the torques of joints without gains, which stay constant over the frame.
pub(crate) fn servos(system: &System, state: &[f64], tau: &[f64], drives: &mut Vec<Drive>, rest: &mut Vec<f64>) {
    let robot = &system.robot;
    let (q, qd) = (&state[robot.root_coords()..], &state[robot.nq() + robot.root_dofs()..]);
    drives.clear();
    rest.clear();
    for (i, spec) in system.joint_specs().enumerate() {
        let drive = Drive { kp: spec.kp, kd: spec.kd, effort: system.torque_limit(i), ..Drive::default() };
        let (drive, held) = match (spec.kp > 0.0, spec.kd > 0.0) {
            (true, _) => (Drive { target: q[i] + (tau[i] + spec.kd * qd[i]) / spec.kp, ..drive }, 0.0),
            (_, true) => (Drive { speed: qd[i] + tau[i] / spec.kd, ..drive }, 0.0),
            _ => (drive, tau[i]),
        };
        drives.push(drive);
        rest.push(held);
    }
}

/// Vector-Jacobian product of [`servos`]: from gradients `by` `[joint][target, speed]` to the gradients with respect to
/// `tau` and to the state in its tangent space. Sets `by_tau` on joints with gains and adds to `by_state`.
pub(crate) fn servos_back(system: &System, by: &[[f64; 2]], by_state: &mut [f64], by_tau: &mut [f64]) {
    let nv = system.robot.nv();
    let dofs = system.robot.root_dofs();
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
