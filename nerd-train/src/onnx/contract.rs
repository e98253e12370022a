//! Description of a policy's inputs and outputs, for users of its ONNX file in another simulator or on the robot.

use super::terms::{Action, Law, Seen};
use super::{law::actions, quantity::observation};
use crate::{ppo::Policy, prelude::*};

/// The contract, as JSON. World axes are those of the robot's file, units are SI, quaternions are x y z w. The root's
/// position and velocity are those of its origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contract {
    /// Name of the policy's task.
    pub task: String,
    /// SHA-256 of weights and moments ([`Policy::sha256`]).
    pub policy_sha256: String,
    /// SHA-256 of the ONNX file.
    pub onnx_sha256: String,
    /// Version of the ONNX operator set.
    pub opset: u64,
    /// Name of the ONNX input, f32: `[batch, numbers]`, or `[batch, frames, numbers]` with the newest frame first.
    pub input: String,
    /// Name of the ONNX output, f32 within [-1, 1]: `[batch, actions]`.
    pub output: String,
    /// The robot's name.
    pub robot: String,
    /// SHA-256 of everything that the robot's motion depends on ([`System::robot_sha256`]).
    pub robot_sha256: String,
    /// Name of the scene in which the policy was trained.
    pub scene: String,
    /// World gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Length of a frame (s), the time between torques.
    pub frame_time: f64,
    /// Number of frames over which an action is kept.
    pub frames_per_action: u64,
    /// Actions per second (Hz).
    pub rate: f64,
    /// Number of stacked observations, one step apart. At the start of an episode, all of them are the first
    /// observation.
    pub observations_seen: usize,
    /// Name and range of each command. In `observation`, the quantity `goal` with index k is entry k here.
    #[serde(default)]
    pub commands: Vec<(String, [f64; 2])>,
    /// Numbers of the observation, in order. The quantity `last action` with index k is entry k of `action`.
    pub observation: Vec<Seen>,
    /// How actions become torques, found in the task's formulas.
    pub law: Law,
    /// Numbers of the action, in order.
    pub action: Vec<Action>,
    /// Names of all joints, in the order of the robot's coordinates.
    pub joints: Vec<String>,
}

impl Contract {
    /// The contract of a policy of `task`, for the ONNX bytes `model` with this input name and operator set version.
    pub(super) fn of(policy: &Policy, task: &dyn Task, model: &[u8], input: &str, opset: u64) -> Result<Self> {
        let system = task.system()?;
        let (law, action) = actions(task, &system);
        let seconds = system.frame_time * task.frames() as f64;
        Ok(Self {
            task: task.name().into(),
            policy_sha256: policy.sha256(),
            onnx_sha256: hex(Sha256::digest(model)),
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
            observation: observation(task, &system),
            law,
            action,
            joints: system.robot.joints().map(|joint| joint.name.clone()).collect(),
        })
    }

    /// Says which numbers of the observation and of the action the contract cannot describe, a line for each of the
    /// two.
    pub fn unknown(&self) -> Vec<String> {
        let places = (0..)
            .zip(&self.observation)
            .filter(|(_, seen)| seen.quantity.is_none())
            .map(|(k, _): (usize, _)| k.to_string())
            .collect_vec();
        let seen = (!places.is_empty())
            .then(|| format!("observation {}: numbers of the task's own, known by their place", places.join(", ")));
        let acted = (self.law == Law::Own)
            .then(|| "action: the task's own law, neither torques nor the robot's controller".to_string());
        seen.into_iter().chain(acted).collect()
    }
}
