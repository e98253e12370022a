//! Controllers: actions in [-1, 1] to joint torques, once a frame, outside any solver.

use std::sync::Arc;

use crate::system::System;

/// A system's own controller: torque, or joint position by a PD law. An action has one entry a joint.
#[derive(Clone, Debug)]
pub struct Controller {
    system: Arc<System>,
    /// Stiffness (N m/rad or N/m) and damping (N m s/rad or N s/m) by joint; without a PD law both are zero.
    pub gains: Vec<[f64; 2]>,
}

impl Controller {
    /// The controller that `system.spec.control` describes.
    pub fn new(system: &Arc<System>) -> Self {
        let gains = system.joint_specs().map(|j| [j.kp, j.kd]).collect();
        Self { system: system.clone(), gains }
    }

    /// Torques for an action at a state `[q, qd]`, one a joint (N m or N).
    ///
    /// Without `[control]`: `gain clamp(a)`. With it: `kp (target - q) - kd qd`, where the target is the default pose, or
    /// with `relative` the present one, plus `scale a`; with `clamp` kept within the gain.
    ///
    /// # Panics
    /// If `state`, `action` and `out` are not of the system's sizes.
    pub fn torques(&self, state: &[f64], action: &[f64], out: &mut [f64]) {
        let robot = &self.system.robot;
        let (q, qd) = state.split_at(robot.nq());
        let (q, qd) = (&q[robot.root_coords()..], &qd[robot.root_dofs()..]);
        assert!(q.len() == action.len() && q.len() == out.len(), "one action and one torque a joint");
        for (i, joint) in self.system.joint_specs().enumerate() {
            let gain = joint.gain.unwrap_or(joint.torque);
            out[i] = match &self.system.spec.control {
                None => gain * action[i].clamp(-1.0, 1.0),
                Some(law) => {
                    let from = if law.relative { q[i] } else { joint.default };
                    let tau = self.gains[i][0] * (from + law.scale * action[i] - q[i]) - self.gains[i][1] * qd[i];
                    if law.clamp { tau.clamp(-gain, gain) } else { tau }
                }
            };
        }
    }
}
