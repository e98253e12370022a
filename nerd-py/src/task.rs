//! Episodes of a task in many environments, the basis of `nerd.gym`.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use nerd_tasks::{Episodes, StepResult};
use numpy::PyArrayDyn;
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};
use crate::error::{alike, room, seeded, step, value};
use crate::solver;
use crate::system::{Named, System};
use crate::threads;

/// Arrays of rewards, terminated, truncated, observations reached, errors, faults and reward terms.
type Stepped<'py> = (Floats<'py>, Bools<'py>, Bools<'py>, Floats<'py>, Floats<'py>, Bools<'py>, Floats<'py>);
type Bools<'py> = Bound<'py, PyArrayDyn<bool>>;

/// Episodes of a task in n environments, the basis of nerd.make_vec and gymnasium.make.
///
/// Task(name, robot=None, n=1, solver="articulated", device="cpu", seed=0, family=None)
///
/// name: a built-in task or the path of a task's .toml. robot: for a task of any robot, a System, a name or a path.
/// seed: random draws of episode k in environment i depend on seed, i and k alone, here and on the command line.
/// family: a robot with [vary], drawn anew for each environment.
#[pyclass(frozen, module = "nerd")]
pub struct Task {
    /// The name or path with which the task was created.
    #[pyo3(get)]
    name: String,
    /// Names of the reward's terms.
    #[pyo3(get)]
    terms: Vec<String>,
    /// The robot.
    #[pyo3(get)]
    system: System,
    /// Number of environments.
    #[pyo3(get)]
    n: usize,
    /// Length of an observation.
    #[pyo3(get)]
    observation: usize,
    /// Length of an action; each component is from -1 to 1.
    #[pyo3(get)]
    action: usize,
    /// Number of steps after which an episode is truncated.
    #[pyo3(get)]
    steps: u64,
    /// Number of frames in a step.
    #[pyo3(get)]
    frames: u64,
    family: Option<String>,
    inner: Mutex<Episodes>,
}

/// A task with its name and its sizes.
pub struct Read {
    pub about: nerd_tasks::About,
    pub name: String,
    pub terms: Vec<String>,
    pub system: System,
    pub family: Option<String>,
}

/// Reads a task by name or path, and begins its episodes in n environments.
///
/// # Errors
/// If the task, the robot or the solver does not exist, or memory does not suffice.
pub fn read(
    name: PathBuf,
    robot: Option<Named>,
    n: i64,
    solver: PathBuf,
    device: &str,
    seed: i64,
    family: Option<Named>,
) -> PyResult<(Read, Episodes)> {
    let robot = robot.map(|robot| format!("@{}", robot.source())).unwrap_or_default();
    let name = format!("{}{robot}", name.display());
    let task = nerd_tasks::named(&name).map_err(|e| value(e.to_string().replace("--robot", "robot=")))?;
    task.about().check().map_err(value)?;
    let system = System::of(task.robot().as_ref(), task.system().map_err(value)?);
    let n = room(n, 64 * (system.system.robot.state_dim() + task.observation_dim()) + 1024)?;
    if family.is_none() {
        alike(&system.system, "family=")?;
    }
    let family = family.map(|family| family.source());
    let spec = solver::spec(Some(&solver), device, &system.system)?;
    let arena = solver::arena(spec, &name, &*task, family.as_deref())?;
    threads::here(n)?;
    let (about, terms) = (task.about(), task.terms().to_vec());
    let mut episodes = arena.begin(task, n, seeded(seed)?).map_err(value)?;
    // These episodes are never continued from a file, so the solver's last frames are not kept.
    episodes.remember(0);
    Ok((Read { about, name, terms, system, family }, episodes))
}

impl Task {
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Episodes) -> T + Send) -> PyResult<T> {
        threads::here(self.n)?;
        Ok(py.detach(|| work(&mut self.inner.lock().unwrap_or_else(PoisonError::into_inner))))
    }

    fn mask(&self, mask: &Bound<'_, PyAny>) -> PyResult<Vec<bool>> {
        numbers::<bool>("mask", mask, &[&[self.n]])
    }
}

#[pymethods]
impl Task {
    #[new]
    #[pyo3(signature = (name, robot=None, n=1, solver=PathBuf::from("articulated"), device="cpu", seed=0, family=None))]
    fn new(
        name: PathBuf,
        robot: Option<Named>,
        n: i64,
        solver: PathBuf,
        device: &str,
        seed: i64,
        family: Option<Named>,
    ) -> PyResult<Self> {
        let (Read { about, name, terms, system, family }, episodes) =
            read(name, robot, n, solver, device, seed, family)?;
        let nerd_tasks::About { observation, action, steps, frames, .. } = about;
        let (n, inner) = (episodes.len(), Mutex::new(episodes));
        Ok(Self { name, terms, system, n, observation, action, steps, frames, family, inner })
    }

    /// step(actions): steps all environments; actions are float64 [n, action], clamped to [-1, 1]. Returns rewards [n],
    /// terminated [n], truncated [n], observations of the states reached [n, observation], errors [n], faults [n],
    /// reward terms [n, terms]. Errors are in units of the task's tolerance, NaN if the task defines no error. A fault
    /// is true where the solver failed. Ended episodes have restarted: observations() then shows their starts.
    ///
    /// Raises ValueError for NaN in actions.
    fn step<'py>(&self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Stepped<'py>> {
        let actions = numbers::<f64>("actions", actions, &[&[self.n, self.action]])?;
        if let Some(at) = actions.iter().position(|x| x.is_nan()) {
            return Err(value(format!("actions: environment {} has NaN; each is from -1 to 1", at / self.action)));
        }
        let StepResult { rewards, terminated, truncated, reached, errors, failed, terms, .. } =
            self.with(py, |all| all.step(&actions))?.map_err(step)?;
        let errors = errors.into_iter().map(|error| error.unwrap_or(f64::NAN)).collect();
        let n = &[self.n];
        let reached = made(py, reached, &[self.n, self.observation])?;
        let [terminated, truncated, failed] = [made(py, terminated, n)?, made(py, truncated, n)?, made(py, failed, n)?];
        let terms = made(py, terms, &[self.n, self.terms.len()])?;
        Ok((made(py, rewards, n)?, terminated, truncated, reached, made(py, errors, n)?, failed, terms))
    }

    /// Observations of the present states, float64 [n, observation].
    fn observations<'py>(&self, py: Python<'py>) -> PyResult<Floats<'py>> {
        made(py, self.with(py, |all| all.observations().to_vec())?, &[self.n, self.observation])
    }

    /// A copy of the present states [q, qd], float64 [n, nq + nv].
    #[getter]
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Floats<'py>> {
        let states = self.with(py, |all| all.simulation.batch.states.clone())?;
        made(py, states, &[self.n, self.system.system.robot.state_dim()])
    }

    /// swap(solver, device="cpu"): continues with another solver from the same states.
    #[pyo3(signature = (solver, device="cpu"))]
    fn swap(&self, py: Python<'_>, solver: PathBuf, device: &str) -> PyResult<()> {
        let task = nerd_tasks::named(&self.name).map_err(value)?;
        let spec = solver::spec(Some(&solver), device, &self.system.system)?;
        let arena = solver::arena(spec, &self.name, &*task, self.family.as_deref())?;
        let solver = arena.begin(task, self.n, 0).map_err(value)?.simulation.solver;
        self.with(py, |all| all.simulation.solver = solver)
    }

    /// reset(seed): begins the first episodes of a seed.
    fn reset(&self, py: Python<'_>, seed: u64) -> PyResult<()> {
        self.with(py, |all| all.seeded(seed))
    }

    /// Numbers of the present episodes, int [n], from 1.
    #[getter]
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<u64>>> {
        made(py, self.with(py, |all| all.numbers().to_vec())?, &[self.n])
    }

    /// begin(mask, numbers): begins the episodes with these numbers, int [n], in the environments of a mask, bool [n].
    fn begin(&self, py: Python<'_>, mask: &Bound<'_, PyAny>, numbers: &Bound<'_, PyAny>) -> PyResult<()> {
        let mask = self.mask(mask)?;
        let numbers = crate::arrays::numbers::<u64>("numbers", numbers, &[&[self.n]])?;
        let episodes: Vec<(usize, u64)> = numbers.into_iter().enumerate().filter(|(env, _)| mask[*env]).collect();
        self.with(py, |all| all.begin_numbered(&episodes))
    }

    /// Names of the tasks that have their own robot.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        nerd_tasks::names()
    }

    /// Names of the tasks for any robot.
    #[staticmethod]
    fn general() -> Vec<&'static str> {
        nerd_tasks::general()
    }
}
