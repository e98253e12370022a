//! A simulation's states on a GPU.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use nerd_cuda::Buffer;
use nerd_sim::articulated::device::SharedStates;
use nerd_sim::prelude::{Simulation, StepError};
use pyo3::prelude::*;

use crate::card::{CardArray, DOUBLE, Order, address, beside};

/// The states of a simulation on a GPU, and the array library (such as torch) that presents them.
pub struct Card {
    shared: Mutex<SharedStates>,
    states: Arc<Buffer<f64>>,
    order: Order,
    xp: Py<PyAny>,
}

impl Card {
    /// Moves the states of a simulation to the GPU.
    pub fn new(simulation: &mut Simulation, xp: Py<PyAny>) -> Result<Self, StepError> {
        let shared = SharedStates::new(simulation)?;
        let (states, order) = (shared.states.clone(), Arc::new(Mutex::new(shared.beside())));
        Ok(Self { shared: Mutex::new(shared), states, order, xp })
    }

    /// Locks the shared states.
    pub fn shared(&self) -> MutexGuard<'_, SharedStates> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Continues with the simulation's new solver, after the simulation has changed it.
    pub fn hold(&self, simulation: &mut Simulation) -> Result<(), StepError> {
        let mut shared = self.shared();
        shared.hold(simulation)?;
        *self.order.lock().unwrap_or_else(PoisonError::into_inner) = shared.beside();
        Ok(())
    }

    /// The GPU address of the torques `tau`, an array of shape `shape`; the solver's stream waits until it is written.
    pub fn torques(&self, tau: &Bound<'_, PyAny>, shape: &[usize]) -> PyResult<u64> {
        address("tau", tau, DOUBLE, shape, &beside(&self.order))
    }

    /// The states as an array of the library `xp`; the library's stream waits until they are written.
    pub fn states<'py>(&self, py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
        let array = CardArray::new(&self.states, &self.states, DOUBLE, shape, &self.order);
        self.xp.bind(py).call_method1("from_dlpack", (array,))
    }
}
