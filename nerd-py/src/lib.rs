//! The native module of the Python package `nerd`: the libraries' objects with numpy arrays as input and output. Python
//! sources are in `python/nerd`.

mod arrays;
#[cfg(feature = "cuda")]
mod card;
#[cfg(feature = "cuda")]
mod card_states;
#[cfg(feature = "cuda")]
mod card_task;
mod dynamics;
mod error;
mod gradients;
mod model;
mod simulation;
mod solver;
mod system;
mod task;
mod threads;

/// The native part of the package.
#[pyo3::pymodule]
mod _nerd {
    use pyo3::prelude::*;

    #[cfg(feature = "cuda")]
    #[pymodule_export]
    use crate::card_task::CardTask;
    #[pymodule_export]
    use crate::gradients::{linearise, vjp};
    #[pymodule_export]
    use crate::model::{Model, Policy};
    #[pymodule_export]
    use crate::simulation::Simulation;
    #[pymodule_export]
    use crate::system::System;
    #[pymodule_export]
    use crate::task::Task;

    /// Loads numpy during import, where Ctrl-C and a missing numpy raise Python's own errors.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.py().import("numpy")?;
        drop(numpy::dtype::<f64>(module.py()));
        Ok(())
    }

    /// Runs the `nerd` command line with these arguments; returns the exit code.
    #[pyfunction]
    fn command(py: Python<'_>, words: Vec<std::ffi::OsString>) -> u8 {
        py.detach(|| nerd_cli::call::call::<nerd_cli::verbs::Package>(words))
    }
}
