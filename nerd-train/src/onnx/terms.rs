//! What observations and actions are made of.

use crate::prelude::*;

/// One number of an observation: `scale * quantity + offset`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seen {
    /// What is observed; none: a number of the task's own, known by its place alone.
    pub quantity: Option<String>,
    /// Of which joint, axis or number.
    pub of: String,
    /// Unit of the quantity.
    pub unit: String,
    /// Factor.
    pub scale: f64,
    /// What is added.
    pub offset: f64,
}

/// How actions become torques (N m or N).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind", deny_unknown_fields)]
pub enum Law {
    /// `tau = scale a`.
    Torque,
    /// `tau = kp (target - q) - kd qd`, kept within `torque` if there is one, anew each frame.
    Position {
        /// Whether the target is `q + scale a`, and not `default + scale a`.
        relative: bool,
        /// Whether q and qd are those that the robot without contact will have a frame h later, linearised: with mass matrix M (armature
        /// included) and bias b, `(M + h kd + h^2 kp) qdd = kp (target - q - h qd) - kd qd - b`,
        /// `tau = kp (target - q - h qd - h^2 qdd) - kd (qd + h qdd)`. A law that is computed at 1 kHz or more needs no such thing.
        ahead: bool,
        /// Whether the law goes on acting inside the frame with the target that it began with, as a motor's own loop at 1 kHz or more does.
        #[serde(default)]
        servo: bool,
    },
    /// The task's own term, in a form not listed here.
    Own,
}

/// One number of an action.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// The joint that it acts at; empty under the task's own law.
    pub joint: String,
    /// Unit of what an action of 1 is `scale` of: the torque, or the target's distance.
    pub unit: String,
    /// What an action of 1 is.
    pub scale: f64,
    /// Default position of the joint (rad or m).
    pub default: f64,
    /// Stiffness (N m/rad or N/m).
    pub kp: f64,
    /// Damping (N m s/rad or N s/m).
    pub kd: f64,
    /// Largest torque (N m) or force (N) that the law gives; none: it sets no bound.
    pub torque: Option<f64>,
    /// What the robot's file says that the drive can give at most (N m or N).
    pub effort: Option<f64>,
}
