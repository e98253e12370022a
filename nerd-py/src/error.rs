//! Errors of the libraries as Python's own kinds, each with its one line.

use std::ffi::CString;
use std::fmt::Display;

use nerd_sim::prelude::{StepError, System};
use nerd_train::bounds;
use pyo3::{PyErr, PyResult, Python, exceptions};

/// Of what was asked for.
pub fn value(error: impl Display) -> PyErr {
    exceptions::PyValueError::new_err(error.to_string())
}

/// Of a step: what the solver has not is a wrong value, what it could not go on with happened at run time.
pub fn step(error: StepError) -> PyErr {
    match error {
        StepError::Refused(line) => value(line),
        other => exceptions::PyRuntimeError::new_err(other.to_string()),
    }
}

/// Refuses numbers of environments out of range, and more than there is memory for, of so many bytes each.
pub fn room(n: i64, each: usize) -> PyResult<usize> {
    let (range, found) = (bounds::STARTS, u64::try_from(n).unwrap_or(0));
    if !range.contains(&found) {
        return Err(value(format!("n={n}: from {} to {} environments", range.start(), range.end())));
    }
    bounds::memory(&[("n", found as usize)], each).map_err(value)?;
    Ok(found as usize)
}

/// Refuses a seed below 0.
pub fn seeded(seed: i64) -> PyResult<u64> {
    u64::try_from(seed).map_err(|_| value(format!("seed={seed}: a whole number from 0 on is needed")))
}

/// Warns of a robot whose `[vary]` is left alone.
pub fn alike(system: &System, option: &str) -> PyResult<()> {
    if system.spec.vary.is_none() {
        return Ok(());
    }
    let line = format!("`{}` has [vary], which is not used here: {option} draws a robot for each environment", system.name);
    Python::attach(|py| PyErr::warn(py, &py.get_type::<exceptions::PyUserWarning>(), &CString::new(line)?, 1))
}
