//! Solvers by their text.

use std::path::Path;
use std::sync::Arc;

use nerd_sim::prelude::{Solver, System};
use nerd_train::device::Device;
use nerd_train::ppo::Arena;
use nerd_train::spec::SolverSpec;
use pyo3::PyResult;

use crate::error::value;

/// Reads a solver from its text, such as "articulated(substeps=4)", or from a model's folder, for the device `device`.
/// Without a text it is the robot's own truth.
///
/// # Errors
/// If `text` names no solver, or the solver does not run on the device.
pub fn spec(text: Option<&Path>, device: &str, system: &System) -> PyResult<SolverSpec> {
    let device = match device {
        "cpu" => Device::Cpu,
        "cuda" if cfg!(feature = "cuda") => Device::Cuda,
        "cuda" => {
            return Err(value("device \"cuda\": this package was built without it; build it with `--features cuda`"));
        }
        other => return Err(value(format!("device {other:?}: choose \"cpu\" or \"cuda\""))),
    };
    let spec: SolverSpec = match text {
        None => system.spec.truth.into(),
        Some(folder) if folder.join("config.json").exists() => SolverSpec::neural(folder),
        // The old word for `articulated(settled)`.
        Some(text) if text == Path::new("settled") => "articulated(settled)".parse().map_err(value)?,
        Some(text) => match text.to_string_lossy().parse() {
            Ok(spec) => spec,
            Err(why) => return Err(value(format!("{why}; or the folder of a model"))),
        },
    };
    let settled = matches!(spec, SolverSpec::Articulated(own) if own.settled);
    if device == Device::Cpu && spec.device() != Device::Cpu {
        return Err(value(format!("device \"cpu\": {spec} says another; name it as device=, too")));
    }
    if device != Device::Cpu && (settled || matches!(spec, SolverSpec::Rapier(_))) {
        return Err(value(format!("device \"cuda\": {spec} is on the CPU")));
    }
    Ok(if device == Device::Cpu { spec } else { spec.on(device) })
}

/// The solver of a system for `n` environments.
///
/// # Errors
/// If a model does not exist, or is of another robot.
pub fn solver(spec: &SolverSpec, system: &Arc<System>, n: usize) -> PyResult<Box<dyn Solver>> {
    spec.solver(system, n).map_err(value)
}

/// The arena in which a task's episodes run, with a family of robots if one is named.
///
/// # Errors
/// Those of [`solver`].
pub fn arena(spec: SolverSpec, name: &str, task: &dyn nerd_tasks::Task, family: Option<&str>) -> PyResult<Arena> {
    if let SolverSpec::Articulated(own) = spec
        && own.settled
    {
        return Err(value("solver articulated(settled) is for gradients: episodes run on \"articulated\""));
    }
    match family {
        Some(family) => Arena::family(name, family, spec).map_err(value),
        None => Arena::of(spec, task).map_err(value),
    }
}
