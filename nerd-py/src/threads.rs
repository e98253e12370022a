//! Refuses parallel work in forked processes, whose worker threads are gone.

use std::sync::OnceLock;

use pyo3::{PyResult, exceptions::PyRuntimeError};

/// Id of the process that first stepped several environments.
static OWNER: OnceLock<u32> = OnceLock::new();

/// Refuses to step several environments in a forked process. The worker threads did not survive the fork, so a step
/// would wait for ever.
pub fn here(n: usize) -> PyResult<()> {
    let me = std::process::id();
    if n > 1 && *OWNER.get_or_init(|| me) != me {
        let line = "this process was forked from one that had stepped environments, and has none of its threads: start it by `spawn`";
        return Err(PyRuntimeError::new_err(line));
    }
    Ok(())
}
