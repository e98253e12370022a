//! A robot held by drives beside MuJoCo's model of the same file, held by the same: how high their roots are after a while.

use serde_json::json;

use super::referee::{Python, REFEREE, from_mujoco, to_mujoco};
use crate::prelude::*;

/// Step of MuJoCo (s).
const STEP: f64 = 5e-4;

/// The state of MuJoCo's model of the MJCF at `path` after `seconds` from `state`, with `drives` at the joints and its own actuators off.
/// It stands on the ground of its file, or where that has none on a plane of MuJoCo's defaults.
pub fn stand(python: &Path, path: &Path, system: &System, state: &[f64], drives: &[Drive], seconds: f64) -> Result<Vec<f64>> {
    let robot = &system.robot;
    let mut python = Python::start(python, REFEREE)?;
    python.ask::<String>(&json!({ "frame_time": STEP, "frames": 0, "starts": [], "path": path, "floor": true }))?;
    let of = |number: fn(&Drive) -> f64| drives.iter().map(number).collect::<Vec<_>>();
    let asked = json!({
        "stand": to_mujoco(robot, state), "kp": of(|d| d.kp), "kd": of(|d| d.kd), "target": of(|d| d.target), "steps": (seconds / STEP).round(),
    });
    let last: Option<Vec<f64>> = python.ask(&asked)?;
    last.map(|last| from_mujoco(robot, &last)).context("MuJoCo gave it up")
}
