//! Entries of observations and actions, and the law from actions to torques.

use crate::prelude::*;

/// One number of an observation: `scale * quantity + offset`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seen {
    /// The observed quantity; none for a number defined by the task, known only by its place.
    pub quantity: Option<String>,
    /// Joint, axis or index of the quantity.
    pub of: String,
    /// Unit of the quantity.
    pub unit: String,
    /// Factor of the quantity.
    pub scale: f64,
    /// Offset, added after the factor.
    pub offset: f64,
}

/// How actions become torques (N m or N).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind", deny_unknown_fields)]
pub enum Law {
    /// `tau = scale a`.
    Torque,
    /// `tau = kp (target - q) - kd qd`, computed once per frame, limited to `torque_limit` if given.
    Position {
        /// Whether the target is `q + scale a`; else `default_q + scale a`.
        relative: bool,
        /// Whether q and qd are predicted a frame h ahead, linearised and without contact. With mass matrix M (armature
        /// included) and bias forces b: `(M + h kd + h^2 kp) qdd = kp (target - q - h qd) - kd qd - b`,
        /// `tau = kp (target - q - h qd - h^2 qdd) - kd (qd + h qdd)`. At 1 kHz or more no prediction is needed.
        stable_pd: bool,
        /// Whether the law also acts inside the frame with a constant target, like a motor's inner loop.
        #[serde(default)]
        servo: bool,
    },
    /// A law of the task in a form not listed here.
    Own,
}

/// One number of an action.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// The actuated joint; empty for [`Law::Own`].
    pub joint: String,
    /// Unit of `scale`: N m or N for a torque, rad or m for a target's distance.
    pub unit: String,
    /// Torque, or distance of the target, for an action of 1.
    pub scale: f64,
    /// Default position of the joint (rad or m).
    pub default_q: f64,
    /// Stiffness (N m/rad or N/m).
    pub kp: f64,
    /// Damping (N m s/rad or N s/m).
    pub kd: f64,
    /// Limit of the law's torque (N m) or force (N); none if the law has no limit.
    pub torque_limit: Option<f64>,
    /// Effort limit in the robot's file (N m or N).
    pub effort: Option<f64>,
}
