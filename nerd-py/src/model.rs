//! Models and policies as folders that hold them.

use std::path::PathBuf;

use nerd_model::folder::ModelConfig;
use nerd_train::ppo::{Actor, folder, play};
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};
use crate::error::{step, value};
use crate::solver::Choice;
use crate::threads;

/// A trained model: a folder that may stand wherever a solver is named.
///
/// Model(folder). Raises ValueError if it holds none.
#[pyclass(frozen, module = "nerd")]
pub struct Model {
    folder: PathBuf,
    config: ModelConfig,
}

#[pymethods]
impl Model {
    #[new]
    fn new(folder: PathBuf) -> PyResult<Self> {
        let config = ModelConfig::read(&folder).map_err(value)?;
        // It stays the same wherever others work.
        Ok(Self { folder: std::path::absolute(folder)?, config })
    }

    fn __fspath__(&self) -> String {
        self.folder.to_string_lossy().into_owned()
    }

    /// Name of the robot that it is of.
    #[getter]
    fn robot(&self) -> &str {
        &self.config.robot
    }

    /// The solver that it learned.
    #[getter]
    fn truth(&self) -> &str {
        &self.config.truth
    }

    /// SHA-256 of all that decides its predictions.
    #[getter]
    fn sha256(&self) -> &str {
        &self.config.model_sha256
    }

    /// Weights of its network.
    #[getter]
    fn parameters(&self) -> usize {
        self.config.network.parameters()
    }

    /// Frames that a prediction depends on; of one frame it has slopes.
    #[getter]
    fn reach(&self) -> usize {
        self.config.network.reach()
    }

    fn __repr__(&self) -> String {
        format!("Model({:?}, robot={:?}, truth={:?})", self.folder.display().to_string(), self.config.robot, self.config.truth)
    }
}

/// A trained policy.
///
/// Policy(folder). Raises ValueError if it holds none.
#[pyclass(frozen, module = "nerd")]
pub struct Policy {
    task: String,
    policy: nerd_train::ppo::Policy,
    actor: Actor,
}

#[pymethods]
impl Policy {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let (config, policy) = folder::load(&path).map_err(value)?;
        Ok(Self { task: config.task, actor: Actor::new(policy.clone()), policy })
    }

    /// The task that it was trained for.
    #[getter]
    fn task(&self) -> &str {
        &self.task
    }

    /// Numbers of a row that it sees: an observation, or of a policy that remembers the newest one and differences of the last ones.
    #[getter]
    fn inputs(&self) -> usize {
        self.policy.shape.inputs()
    }

    /// policy(rows): mean actions, float64 [n, action], for rows, float64 [n, inputs].
    fn __call__<'py>(&self, py: Python<'py>, rows: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
        let n = rows.len()?;
        let rows = numbers::<f64>("rows", rows, &[&[n, self.inputs()]])?;
        threads::here(n)?;
        let actions = py.detach(|| self.actor.mean(&rows));
        made(py, actions, &[n, self.policy.shape.action])
    }

    /// play(n, seed=0, solver="articulated", device="cpu"): rewards and lengths, float64 [n], of n first episodes under mean actions, as
    /// the command line's `policy evaluate` plays them.
    #[pyo3(signature = (n, seed=0, solver=PathBuf::from("articulated"), device="cpu"))]
    fn play<'py>(&self, py: Python<'py>, n: usize, seed: u64, solver: PathBuf, device: &str) -> PyResult<(Floats<'py>, Floats<'py>)> {
        threads::here(n)?;
        let robot = nerd_tasks::named(&self.task).map_err(value)?.robot();
        let mut episodes = Choice::new(solver, device)?.arena(&self.task, robot)?.episodes(&self.task, n, seed).map_err(value)?;
        episodes.remember(0);
        let games = py.detach(|| play(&self.policy, &mut episodes, &mut |_| {})).map_err(step)?;
        let (rewards, lengths) = games.iter().map(|game| (game.reward, game.length)).unzip();
        Ok((made(py, rewards, &[n])?, made(py, lengths, &[n])?))
    }
}
