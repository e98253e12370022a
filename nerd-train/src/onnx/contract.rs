//! What a policy's numbers mean, for whoever runs its ONNX on another simulator or on the robot.

use super::terms::{Action, Law, Seen};
use super::{law::actions, quantity::observation};
use crate::{ppo::Policy, prelude::*};

/// The contract, as JSON. World axes are the robot's file's; SI units; quaternions x y z w; the root's position and velocity are taken at
/// its origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contract {
    /// What it was trained for.
    pub task: String,
    /// SHA-256 of weights and moments ([`Policy::sha256`]).
    pub policy_sha256: String,
    /// SHA-256 of the ONNX file.
    pub onnx_sha256: String,
    /// Version of ONNX's operators.
    pub opset: u64,
    /// Name of the ONNX's input, in f32: `[batch, numbers]`, or `[batch, frames, numbers]` with the newest frame first.
    pub input: String,
    /// Name of its output, in f32, within [-1, 1]: `[batch, actions]`.
    pub output: String,
    /// The robot's name.
    pub robot: String,
    /// SHA-256 of everything in the robot that its motion depends on ([`System::robot_sha256`]).
    pub robot_sha256: String,
    /// The scene that it was trained in.
    pub scene: String,
    /// World gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Seconds between two torques.
    pub frame_time: f64,
    /// Frames of one action.
    pub frames_per_action: u64,
    /// Actions a second (Hz).
    pub rate: f64,
    /// Observations that the policy sees at once, a step apart; at the start of an episode the first counts for those before it.
    pub observations_seen: usize,
    /// What is asked for, name and range each: quantity `goal` of number k is entry k.
    #[serde(default)]
    pub commands: Vec<(String, [f64; 2])>,
    /// The observation's numbers, in order; `last action` of number k is of entry k of `action`.
    pub observation: Vec<Seen>,
    /// How actions become torques, found by asking the task.
    pub law: Law,
    /// The action's numbers, in order.
    pub action: Vec<Action>,
    /// Names of all joints in the order of the robot's coordinates.
    pub joints: Vec<String>,
}

impl Contract {
    /// Of a policy of this task, whose model is these bytes, with this input and version of operators.
    pub(super) fn of(policy: &Policy, task: &dyn Task, model: &[u8], input: &str, opset: u64) -> Result<Self> {
        let system = task.system()?;
        let (law, action) = actions(task, &system)?;
        let seconds = system.frame_time * task.frames() as f64;
        Ok(Self {
            task: task.name().into(),
            policy_sha256: policy.sha256(),
            onnx_sha256: Sha256::digest(model).iter().map(|b| format!("{b:02x}")).collect(),
            opset,
            input: input.into(),
            output: "action".into(),
            robot: system.name.clone(),
            robot_sha256: system.robot_sha256(),
            scene: task.scene().into(),
            gravity: system.gravity().into(),
            frame_time: system.frame_time,
            frames_per_action: task.frames(),
            rate: 1.0 / seconds,
            observations_seen: policy.shape.stack,
            commands: task.commands(),
            observation: observation(task, &system)?,
            law,
            action,
            joints: system.robot.joints().map(|joint| joint.name.clone()).collect(),
        })
    }

    /// What it cannot say, a line each.
    pub fn unknown(&self) -> Vec<String> {
        let places: Vec<String> =
            (0..).zip(&self.observation).filter(|(_, seen)| seen.quantity.is_none()).map(|(k, _): (usize, _)| k.to_string()).collect();
        let seen =
            (!places.is_empty()).then(|| format!("observation {}: numbers of the task's own, known by their place", places.join(", ")));
        let acted = (self.law == Law::Own).then(|| "action: the task's own law, neither torques nor the robot's controller".to_string());
        seen.into_iter().chain(acted).collect()
    }
}
