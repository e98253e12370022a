//! Maps errors of the libraries to Python exceptions, each with one line of text.

use std::ffi::CString;
use std::fmt::Display;

use nerd_sim::prelude::{StepError, System};
use nerd_train::bounds;
use pyo3::{PyErr, PyResult, Python, exceptions};

/// A `ValueError` for a wrong argument.
pub fn value(error: impl Display) -> PyErr {
    exceptions::PyValueError::new_err(error.to_string())
}

/// The exception for a failed step: `ValueError` for an unsupported feature, else `RuntimeError`.
pub fn step(error: StepError) -> PyErr {
    match error {
        StepError::Refused(line) => value(line),
        other => exceptions::PyRuntimeError::new_err(other.to_string()),
    }
}

/// Refuses a number of environments that is out of range, or too large for the available memory at `each` bytes per
/// environment.
pub fn room(n: i64, each: usize) -> PyResult<usize> {
    let (range, found) = (bounds::STARTS, u64::try_from(n).unwrap_or(0));
    if !range.contains(&found) {
        return Err(value(format!("n={n}: from {} to {} environments", range.start(), range.end())));
    }
    bounds::memory(&[("n", found as usize)], each).map_err(value)?;
    Ok(found as usize)
}

/// Refuses a negative seed.
pub fn seeded(seed: i64) -> PyResult<u64> {
    u64::try_from(seed).map_err(|_| value(format!("seed={seed}: a whole number from 0 on is needed")))
}

/// Warns that a robot's `[vary]` is ignored, and names the `option` that would use it.
pub fn alike(system: &System, option: &str) -> PyResult<()> {
    if system.spec.vary.is_none() {
        return Ok(());
    }
    let line =
        format!("`{}` has [vary], which is not used here: {option} draws a robot for each environment", system.name);
    Python::attach(|py| PyErr::warn(py, &py.get_type::<exceptions::PyUserWarning>(), &CString::new(line)?, 1))
}
