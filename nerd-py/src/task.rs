//! Episodes of a task in many environments, as `nerd.gym` makes environments of them.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use nerd_tasks::{Episodes, StepResult};
use numpy::PyArrayDyn;
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};
use crate::error::{room, step, value};
use crate::solver::Choice;
use crate::system::System;
use crate::threads;

/// Rewards, terminated, truncated, observations reached, misses.
type Stepped<'py> = (Floats<'py>, Bound<'py, PyArrayDyn<bool>>, Bound<'py, PyArrayDyn<bool>>, Floats<'py>, Floats<'py>);

/// Episodes of a task in n environments, below nerd.make_vec and gymnasium.make.
///
/// Task(name, robot=None, n=1, solver="articulated", device="cpu", seed=0)
///
/// name: a built-in task or the path of a task's .toml; robot: of a task for any robot, a name or a path. seed: what episode k of
/// environment i draws depends on it, i and k alone, here and on the command line.
#[pyclass(frozen, module = "nerd")]
pub struct Task {
    about: nerd_tasks::About,
    name: String,
    system: System,
    n: usize,
    inner: Mutex<Episodes>,
}

/// What a task is, by its name.
pub struct Read {
    pub about: nerd_tasks::About,
    pub name: String,
    pub system: System,
}

/// A task by its name or path, and its episodes in n environments.
///
/// # Errors
/// If there is no such task, robot or solver, or not as much memory.
pub fn read(name: PathBuf, robot: Option<PathBuf>, n: usize, solver: PathBuf, device: &str, seed: u64) -> PyResult<(Read, Episodes)> {
    let robot = robot.map(|robot| format!("@{}", robot.display())).unwrap_or_default();
    let name = format!("{}{robot}", name.display());
    let task = nerd_tasks::named(&name).map_err(value)?;
    task.about().check().map_err(value)?;
    let system = System::of(task.robot().as_ref(), task.system().map_err(value)?);
    room(n, 64 * (system.system.robot.state_dim() + task.observation_dim()) + 1024)?;
    let (about, arena) = (task.about(), Choice::new(solver, device)?.arena(&name, task.robot())?);
    threads::here(n)?;
    let mut episodes = arena.part(task, 0..n, seed).map_err(value)?;
    // Nobody goes on with these from a file.
    episodes.remember(0);
    Ok((Read { about, name, system }, episodes))
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
    #[pyo3(signature = (name, robot=None, n=1, solver=PathBuf::from("articulated"), device="cpu", seed=0))]
    fn new(name: PathBuf, robot: Option<PathBuf>, n: usize, solver: PathBuf, device: &str, seed: u64) -> PyResult<Self> {
        let (Read { about, name, system }, episodes) = read(name, robot, n, solver, device, seed)?;
        Ok(Self { about, name, system, n, inner: Mutex::new(episodes) })
    }

    /// step(actions): float64 [n, action], clamped to [-1, 1]. Rewards [n], terminated [n], truncated [n], observations [n,
    /// observation] of the states reached, and [n] by how much each missed what is asked for, in units of what may be missed (NaN
    /// of a task that does not speak of success). Ended episodes have restarted: observations() are those of the new ones.
    fn step<'py>(&self, py: Python<'py>, actions: &Bound<'py, PyAny>) -> PyResult<Stepped<'py>> {
        let actions = numbers::<f64>("actions", actions, &[&[self.n, self.about.action]])?;
        let StepResult { rewards, terminated, truncated, reached, misses, .. } = self.with(py, |all| all.step(&actions))?.map_err(step)?;
        let misses = misses.into_iter().map(|miss| miss.unwrap_or(f64::NAN)).collect();
        let n = &[self.n];
        let reached = made(py, reached, &[self.n, self.about.observation])?;
        Ok((made(py, rewards, n)?, made(py, terminated, n)?, made(py, truncated, n)?, reached, made(py, misses, n)?))
    }

    /// Observations of the present states, float64 [n, observation].
    fn observations<'py>(&self, py: Python<'py>) -> PyResult<Floats<'py>> {
        made(py, self.with(py, |all| all.observations().to_vec())?, &[self.n, self.about.observation])
    }

    /// reset(seed): the first episodes of a seed.
    fn reset(&self, py: Python<'_>, seed: u64) -> PyResult<()> {
        self.with(py, |all| all.seeded(seed))?.map_err(step)
    }

    /// Numbers of the present episodes, int [n], of which the first is 1.
    #[getter]
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<u64>>> {
        made(py, self.with(py, |all| all.numbers().to_vec())?, &[self.n])
    }

    /// begin(mask, numbers): begins the episodes of these numbers, int [n], in the environments of a mask, bool [n].
    fn begin(&self, py: Python<'_>, mask: &Bound<'_, PyAny>, numbers: &Bound<'_, PyAny>) -> PyResult<()> {
        let mask = self.mask(mask)?;
        let numbers = crate::arrays::numbers::<u64>("numbers", numbers, &[&[self.n]])?;
        let episodes: Vec<(usize, u64)> = numbers.into_iter().enumerate().filter(|(env, _)| mask[*env]).collect();
        self.with(py, |all| all.begin_numbered(&episodes))?.map_err(step)
    }

    /// What it was called by.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// The robot.
    #[getter]
    fn system(&self) -> System {
        self.system.clone()
    }

    /// Environments.
    #[getter]
    fn n(&self) -> usize {
        self.n
    }

    /// Numbers of an observation.
    #[getter]
    fn observation(&self) -> usize {
        self.about.observation
    }

    /// Numbers of an action, each from -1 to 1.
    #[getter]
    fn action(&self) -> usize {
        self.about.action
    }

    /// Steps after which an episode is truncated.
    #[getter]
    fn steps(&self) -> u64 {
        self.about.steps
    }

    /// Frames of a step.
    #[getter]
    fn frames(&self) -> u64 {
        self.about.frames
    }

    /// Names of the tasks that have a robot.
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
