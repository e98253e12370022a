//! Episodes on a GPU, the basis of `nerd.make_vec(..., device="cuda")`.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use nerd_train::ppo::CudaEpisodes;
use pyo3::prelude::*;

use crate::card::{BOOL, CardArray, Order, SINGLE, address, beside};
use crate::error::value;
use crate::system::Named;
use crate::task::read;

/// Episodes of a task in n environments on a GPU. Results are GPU arrays whose memory is the same in every step.
///
/// CardTask(name, robot=None, n=1, solver="articulated", family=None)
#[pyclass(frozen, module = "nerd")]
pub struct CardTask {
    /// Length of an observation.
    #[pyo3(get)]
    observation: usize,
    /// Length of an action; each component is from -1 to 1.
    #[pyo3(get)]
    action: usize,
    n: usize,
    order: Order,
    inner: Mutex<CudaEpisodes>,
}

impl CardTask {
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut CudaEpisodes) -> nerd_train::Result<T> + Send,
    ) -> PyResult<T> {
        py.detach(|| work(&mut self.inner.lock().unwrap_or_else(PoisonError::into_inner))).map_err(value)
    }
}

#[pymethods]
impl CardTask {
    #[new]
    #[pyo3(signature = (name, robot=None, n=1, solver=PathBuf::from("articulated"), family=None))]
    fn new(
        py: Python<'_>,
        name: PathBuf,
        robot: Option<Named>,
        n: i64,
        solver: PathBuf,
        family: Option<Named>,
    ) -> PyResult<Self> {
        let (task, episodes) = read(name, robot, n, solver, "cuda", 0, family)?;
        let n = episodes.len();
        let inner = py.detach(|| CudaEpisodes::new(episodes)).map_err(value)?;
        let nerd_tasks::About { observation, action, .. } = task.about;
        Ok(Self { observation, action, n, order: Arc::new(Mutex::new(inner.beside())), inner: Mutex::new(inner) })
    }

    /// step(actions): steps all environments with actions, float32 [n, action] on the GPU, without waiting for the GPU.
    /// arrays() gives the results.
    fn step(&self, py: Python<'_>, actions: &Bound<'_, PyAny>) -> PyResult<()> {
        let actions = address("actions", actions, SINGLE, &[self.n, self.action], &beside(&self.order))?;
        self.with(py, |all| all.step(actions))
    }

    /// reset(seed): begins the first episodes of the random seed `seed` in all environments.
    fn reset(&self, py: Python<'_>, seed: u64) -> PyResult<()> {
        self.with(py, |all| all.seeded(seed))
    }

    /// Observations [n, observation], rewards [n], terminated [n], truncated [n], and the observations [n, observation]
    /// reached before ended episodes restarted.
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

    /// Number of episodes since the last call that ended, without reward, because the solver failed. Waits for the GPU.
    fn failed(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, CudaEpisodes::failed)
    }
}
