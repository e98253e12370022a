//! Episodes that stay on a card, below `nerd.make_vec(..., device="cuda")`.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use nerd_train::ppo::CudaEpisodes;
use pyo3::prelude::*;

use crate::card::{BOOL, CardArray, Order, SINGLE, address, beside};
use crate::error::value;
use crate::system::Named;
use crate::task::read;

/// Episodes of a task in n environments on a card, whose results are arrays there: the same memory in every step.
///
/// CardTask(name, robot=None, n=1, solver="articulated", family=None)
#[pyclass(frozen, module = "nerd")]
pub struct CardTask {
    /// Numbers of an observation.
    #[pyo3(get)]
    observation: usize,
    /// Numbers of an action, each from -1 to 1.
    #[pyo3(get)]
    action: usize,
    n: usize,
    order: Order,
    inner: Mutex<CudaEpisodes>,
}

impl CardTask {
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut CudaEpisodes) -> nerd_train::Result<T> + Send) -> PyResult<T> {
        py.detach(|| work(&mut self.inner.lock().unwrap_or_else(PoisonError::into_inner))).map_err(value)
    }
}

#[pymethods]
impl CardTask {
    #[new]
    #[pyo3(signature = (name, robot=None, n=1, solver=PathBuf::from("articulated"), family=None))]
    fn new(py: Python<'_>, name: PathBuf, robot: Option<Named>, n: i64, solver: PathBuf, family: Option<Named>) -> PyResult<Self> {
        let (task, episodes) = read(name, robot, n, solver, "cuda", 0, family)?;
        let n = episodes.len();
        let inner = py.detach(|| CudaEpisodes::new(episodes)).map_err(value)?;
        let nerd_tasks::About { observation, action, .. } = task.about;
        Ok(Self { observation, action, n, order: Arc::new(Mutex::new(inner.beside())), inner: Mutex::new(inner) })
    }

    /// step(actions): float32 [n, action] on the card. It does not wait; arrays() are what comes of it.
    fn step(&self, py: Python<'_>, actions: &Bound<'_, PyAny>) -> PyResult<()> {
        let actions = address("actions", actions, SINGLE, &[self.n, self.action], &beside(&self.order))?;
        self.with(py, |all| all.step(actions))
    }

    /// reset(seed): the first episodes of a seed.
    fn reset(&self, py: Python<'_>, seed: u64) -> PyResult<()> {
        self.with(py, |all| all.seeded(seed))
    }

    /// Observations, rewards, terminated, truncated, and observations reached before ended episodes began anew.
    fn arrays(&self) -> [CardArray; 5] {
        let shown = self.inner.lock().unwrap_or_else(PoisonError::into_inner).shown().clone();
        let (rows, n) = ([self.n, self.observation], [self.n]);
        let single = |of, shape: &[usize]| CardArray::new(&shown, of, SINGLE, shape, &self.order);
        let flags = |of| CardArray::new::<u8, _>(&shown, of, BOOL, &n, &self.order);
        [
            single(&shown.observations, &rows),
            single(&shown.rewards, &n),
            flags(&shown.terminated),
            flags(&shown.truncated),
            single(&shown.reached, &rows),
        ]
    }

    /// Episodes that the solver could not go on with since this was asked last, which ended without a reward. It waits for the card.
    fn failed(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, CudaEpisodes::failed)
    }
}
