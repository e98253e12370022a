//! Models and policies, read from their folders.

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

/// A trained model. The path of its folder is accepted wherever a solver is named.
///
/// Model(folder). Raises ValueError if the folder holds no model.
#[pyclass(frozen, module = "nerd")]
pub struct Model {
    folder: PathBuf,
    /// Name of the model's robot.
    #[pyo3(get)]
    robot: String,
    /// Name of the solver whose motion the model learned.
    #[pyo3(get)]
    truth: String,
    /// SHA-256 of everything that determines the model's predictions.
    #[pyo3(get)]
    sha256: String,
    /// Number of the network's weights.
    #[pyo3(get)]
    parameters: usize,
    /// Number of frames that a prediction depends on. A model of one frame has gradients.
    #[pyo3(get)]
    reach: usize,
}

#[pymethods]
impl Model {
    #[new]
    fn new(folder: PathBuf) -> PyResult<Self> {
        let ModelConfig { robot, truth, model_sha256: sha256, network, .. } =
            ModelConfig::read(&folder).map_err(value)?;
        // An absolute path stays valid in other working directories.
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

/// A trained policy: policy(rows) gives its mean actions.
///
/// Policy(folder). Raises ValueError if the folder holds no policy.
#[pyclass(frozen, module = "nerd")]
pub struct Policy {
    folder: PathBuf,
    /// The task that the policy was trained for.
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

    /// Length of an input row, which is an observation. For a policy with memory, the row is the newest observation and
    /// differences of the last observations.
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

    /// play(n, seed=0, solver="articulated", device="cpu", family=None): plays the first episode in each of n
    /// environments under mean actions, as the command `policy evaluate` does. Returns sums of rewards and lengths
    /// (steps), float64 [n] each.
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
