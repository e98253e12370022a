//! Errors of the libraries as Python's own kinds, each with its one line.

use std::fmt::Display;

use nerd_sim::solver::StepError;
use nerd_train::bounds;
use pyo3::{PyErr, PyResult, exceptions};

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
pub fn room(n: usize, each: usize) -> PyResult<()> {
    let range = bounds::STARTS;
    if !range.contains(&(n as u64)) {
        return Err(value(format!("n={n}: from {} to {} environments", range.start(), range.end())));
    }
    bounds::memory(&[("n", n)], each).map_err(value)
}
