//! Simulates a robot's own file in MuJoCo, with joints held by drives, to find where the robot comes to rest.

use serde_json::json;

use super::python::Python;
use super::states::{from_mujoco, to_mujoco};
use crate::prelude::*;

/// Time step of MuJoCo (s).
const STEP: f64 = 5e-4;

/// Simulates the MJCF at `path` in MuJoCo for `seconds` from `state`, and returns the final state. `drives` hold the
/// joints; the file's own actuators are off. A file without ground gets a plane with MuJoCo's default contact.
pub fn stand(
    python: &Path,
    path: &Path,
    system: &System,
    state: &[f64],
    drives: &[Drive],
    seconds: f64,
) -> Result<Vec<f64>> {
    let robot = &system.robot;
    let mut python = Python::of_model(python, json!({ "frame_time": STEP, "path": path, "floor": true }))?;
    let of = |number: fn(&Drive) -> f64| drives.iter().map(number).collect_vec();
    let asked = json!({
        "stand": to_mujoco(robot, state), "kp": of(|d| d.kp), "kd": of(|d| d.kd), "target": of(|d| d.target), "steps": (seconds / STEP).round(),
    });
    let last: Option<Vec<f64>> = python.ask(&asked)?;
    last.map(|last| from_mujoco(robot, &last)).context("MuJoCo gave it up")
}
