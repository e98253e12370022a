//! Models and policies as folders that hold them.

use std::path::PathBuf;

use nerd_model::folder::ModelConfig;
use nerd_train::ppo::{Actor, folder, play};
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};
use crate::error::{step, value};
use crate::system::Named;
use crate::task::read;
use crate::threads;

/// A trained model: a folder that may stand wherever a solver is named.
///
/// Model(folder). Raises ValueError if it holds none.
#[pyclass(frozen, module = "nerd")]
pub struct Model {
    folder: PathBuf,
    /// Name of its robot.
    #[pyo3(get)]
    robot: String,
    /// The solver that it learned.
    #[pyo3(get)]
    truth: String,
    /// SHA-256 of everything that determines its predictions.
    #[pyo3(get)]
    sha256: String,
    /// Weights of its network.
    #[pyo3(get)]
    parameters: usize,
    /// Frames that a prediction depends on; a model of one frame has gradients.
    #[pyo3(get)]
    reach: usize,
}

#[pymethods]
impl Model {
    #[new]
    fn new(folder: PathBuf) -> PyResult<Self> {
        let ModelConfig { robot, truth, model_sha256: sha256, network, .. } = ModelConfig::read(&folder).map_err(value)?;
        // An absolute path stays valid wherever others work.
        let folder = std::path::absolute(folder)?;
        Ok(Self { folder, robot, truth, sha256, parameters: network.parameters(), reach: network.reach() })
    }

    fn __fspath__(&self) -> String {
        self.folder.to_string_lossy().into_owned()
    }

    fn __repr__(&self) -> String {
        format!("Model({:?}, robot={:?}, truth={:?})", self.folder.display().to_string(), self.robot, self.truth)
    }
}

/// A trained policy.
///
/// Policy(folder). Raises ValueError if it holds none.
#[pyclass(frozen, module = "nerd")]
pub struct Policy {
    folder: PathBuf,
    /// The task that it was trained for.
    #[pyo3(get)]
    task: String,
    policy: nerd_train::ppo::Policy,
    actor: Actor,
}

#[pymethods]
impl Policy {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let (config, policy) = folder::load(&path).map_err(value)?;
        let folder = std::path::absolute(path)?;
        Ok(Self { folder, task: config.task, actor: Actor::new(policy.clone()), policy })
    }

    fn __fspath__(&self) -> String {
        self.folder.to_string_lossy().into_owned()
    }

    fn __repr__(&self) -> String {
        format!("Policy({:?}, task={:?}, inputs={})", self.folder.display().to_string(), self.task, self.inputs())
    }

    /// Numbers of an input row: an observation; for a policy with memory, the newest one and differences of the last ones.
    #[getter]
    fn inputs(&self) -> usize {
        self.policy.shape.inputs()
    }

    /// policy(rows): mean actions, float64 [n, action], for rows, float64 [n, inputs]; one row [inputs] gives [action].
    fn __call__<'py>(&self, py: Python<'py>, rows: &Bound<'py, PyAny>) -> PyResult<Floats<'py>> {
        let (n, [inputs, action]) = (rows.len()?, [self.inputs(), self.policy.shape.action]);
        let numbers = numbers::<f64>("rows", rows, &[&[n, inputs], &[inputs]])?;
        threads::here(numbers.len() / inputs)?;
        let actions = py.detach(|| self.actor.mean(&numbers));
        let alone = rows.cast::<PyUntypedArray>()?.ndim() == 1;
        made(py, actions, &[n, action][usize::from(alone)..])
    }

    /// play(n, seed=0, solver="articulated", device="cpu", family=None): rewards and lengths, float64 [n], of n first episodes under mean actions, as
    /// the command line's `policy evaluate` plays them.
    #[pyo3(signature = (n, seed=0, solver=PathBuf::from("articulated"), device="cpu", family=None))]
    fn play<'py>(
        &self,
        py: Python<'py>,
        n: i64,
        seed: i64,
        solver: PathBuf,
        device: &str,
        family: Option<Named>,
    ) -> PyResult<(Floats<'py>, Floats<'py>)> {
        let (_, mut episodes) = read(PathBuf::from(&self.task), None, n, solver, device, seed, family)?;
        let n = episodes.len();
        let games = py.detach(|| play(&self.policy, &mut episodes, &mut |_| {})).map_err(step)?;
        let (rewards, lengths) = games.iter().map(|game| (game.reward, game.length)).unzip();
        Ok((made(py, rewards, &[n])?, made(py, lengths, &[n])?))
    }
}
