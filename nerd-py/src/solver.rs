//! Solvers by name.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nerd_model::pick::Setting;
use nerd_sim::prelude::{Articulated, ArticulatedConfig, Solver, System, Truth};
use nerd_sim::rig::Rig;
use nerd_sim::vary::VarySpec;
use nerd_train::{device::Device, ppo::Arena, shipped};
use pyo3::PyResult;

use crate::error::value;

/// Relative change of drags at which a substep counts as solved, and the most solves.
const SETTLED: f64 = 1e-13;
const SOLVES: usize = 1000;

/// A solver by name: "articulated", "settled" (the same, each substep solved to convergence, for exact gradients), "rapier" or "neural"
/// (the model that comes with the project), or a model's folder; and its device.
pub struct Choice {
    pub word: PathBuf,
    pub device: Device,
}

impl Choice {
    /// From words.
    ///
    /// # Errors
    /// If this build has no such device.
    pub fn new(word: PathBuf, device: &str) -> PyResult<Self> {
        let device = match device {
            "cpu" => Device::Cpu,
            "cuda" if cfg!(feature = "cuda") => Device::Cuda,
            "cuda" => return Err(value("device \"cuda\": this package was built without it; build it with `--features cuda`")),
            other => return Err(value(format!("device {other:?}: choose \"cpu\" or \"cuda\""))),
        };
        Self { word, device }.checked()
    }

    /// Returns itself if the solver runs on the device.
    ///
    /// # Errors
    /// If it runs on the CPU alone.
    pub fn checked(self) -> PyResult<Self> {
        if self.device != Device::Cpu && ["rapier", "settled"].into_iter().any(|name| self.word == Path::new(name)) {
            return Err(value(format!("device \"cuda\": {} is on the CPU", self.word.display())));
        }
        Ok(self)
    }

    /// The solver of a system for `n` environments.
    ///
    /// # Errors
    /// If no solver has this name, or the model is of another robot.
    pub fn solver(&self, system: &Arc<System>, n: usize) -> PyResult<Box<dyn Solver>> {
        let setting = match self.word.to_str() {
            Some("articulated") if system.spec.truth == Truth::Paper => Setting::Paper,
            Some("articulated") => Setting::Accurate,
            Some("settled") => {
                return Ok(Box::new(Articulated::new(ArticulatedConfig::accurate(system)).settling(SETTLED, SOLVES)));
            }
            Some("rapier") => Truth::Rapier.into(),
            Some("neural") => {
                let folder = found(shipped::model(system.spec.truth, &system.name), &system.name)?;
                return self.device.neural(&folder, system, None, n).map_err(value);
            }
            _ => return self.device.neural(&self.folder()?, system, None, n).map_err(value),
        };
        #[cfg(feature = "cuda")]
        if self.device.is_cuda() {
            use nerd_sim::articulated::device::Real;
            use nerd_train::learner::cuda::Precision;
            return Ok(nerd_train::device::resident(&setting, system, Real::F32, Precision::F16).map_err(value)?);
        }
        let solver = setting.solver(system).map_err(value)?;
        let motors = system.spec.vary.as_ref().is_some_and(VarySpec::rigged);
        Ok(if motors { Box::new(Rig::new(solver)) } else { solver })
    }

    /// The arena of a task's episodes, with a family if one is named.
    ///
    /// # Errors
    /// As [`Self::solver`].
    pub fn arena(&self, task: &str, robot: &str, family: Option<&str>) -> PyResult<Arena> {
        if let Some(family) = family {
            let truth = match self.word.to_str() {
                Some("articulated") => Truth::Articulated,
                Some("rapier") => Truth::Rapier,
                _ => return Err(value("family: robots that differ are stepped by \"articulated\" or \"rapier\"")),
            };
            return Arena::family(task, family, truth, self.device).map_err(value);
        }
        Ok(match self.word.to_str() {
            #[cfg(feature = "cuda")]
            Some("articulated") if self.device.is_cuda() => Arena::Card(Setting::Accurate),
            Some("articulated") => Arena::Truth(Truth::Articulated),
            Some("rapier") => Arena::Truth(Truth::Rapier),
            Some("settled") => return Err(value("solver \"settled\" is for slopes: episodes run on \"articulated\"")),
            Some("neural") => Arena::Model { folder: found(shipped::model_of_task(task, robot), robot)?, device: self.device },
            _ => Arena::Model { folder: self.folder()?, device: self.device },
        })
    }

    fn folder(&self) -> PyResult<PathBuf> {
        if self.word.join("config.json").exists() {
            return Ok(self.word.clone());
        }
        let word = self.word.display();
        Err(value(format!("no solver {word}: choose \"articulated\", \"settled\", \"rapier\", \"neural\" or the folder of a model")))
    }
}

fn found(folder: PathBuf, robot: &str) -> PyResult<PathBuf> {
    if folder.join("config.json").exists() {
        return Ok(folder);
    }
    Err(value(format!("no model of `{robot}` in models/ of a project around this folder: train one and name its folder")))
}
