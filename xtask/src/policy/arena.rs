//! Where a policy acts: a task's robot and scene, and a solver by name.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::neural::Neural;
use nerd_sim::prelude::*;
use nerd_tasks::{Episodes, named};

use super::clock::{Clock, Timed};
use crate::common::{DEVICES, Device, word};
use crate::flags::unused;
use crate::solvers::SolverName;
use nerd_sim::truth::Truth;

/// A solver that episodes run on.
#[derive(clap::Args, Clone, Debug)]
pub struct Arena {
    /// Solver: neural, or one of the truths, articulated (preset paper, Coulomb friction) and rapier (16 steps)
    #[arg(long, value_enum, default_value_t = SolverName::Articulated)]
    pub solver: SolverName,
    /// Folder of the model of `neural` [default: models/ROBOT]
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Where `neural` is computed
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
}

impl Arena {
    /// Folder of the model for a robot.
    pub fn folder(&self, robot: &str) -> PathBuf {
        self.model.clone().unwrap_or_else(|| nerd_train::shipped::model(Truth::Articulated, robot))
    }

    /// The solver in words that tell it from any other, settings and all.
    pub fn title(&self, robot: &str) -> Result<String> {
        Ok(match self.solver {
            SolverName::Articulated => Truth::Articulated.name(),
            SolverName::Rapier => Truth::Rapier.name(),
            SolverName::Neural => {
                let folder = self.folder(robot);
                format!("neural {} of {}", folder.display(), ModelConfig::read(&folder)?.truth)
            }
        })
    }

    /// Refuses options of the learned solver for another one.
    pub fn check(&self) -> Result<()> {
        if self.solver == SolverName::Neural {
            return Ok(());
        }
        let given = [("--model", self.model.is_some()), ("--device", self.device != Device::Cpu)];
        unused(&given, "without --solver neural")
    }

    /// What the solver computes, by content: robot, truth or model, whatever their folder is called.
    pub fn identity(&self, system: &System) -> Result<String> {
        let solver = match self.solver {
            SolverName::Articulated => Truth::Articulated.name(),
            SolverName::Rapier => Truth::Rapier.name(),
            SolverName::Neural => {
                let ModelConfig { truth, model_sha256, .. } = ModelConfig::read(&self.folder(&system.name))?;
                format!("model {} of {truth}", model_sha256.get(..16).unwrap_or("without a hash"))
            }
        };
        Ok(format!("{solver}, robot {} {}", system.name, &system.sha256()[..16]))
    }

    /// Its name in a folder's.
    pub fn word(&self) -> String {
        format!("{:?}", self.solver).to_lowercase()
    }

    /// `n` episodes of a task.
    pub fn episodes(&self, task: &str, n: usize, seed: u64) -> Result<Episodes> {
        self.timed(task, n, seed, &Clock::default())
    }

    /// The same, with the time that its solver takes on a clock.
    pub fn timed(&self, task: &str, n: usize, seed: u64, clock: &Clock) -> Result<Episodes> {
        let task = named(task)?;
        let system = System::named(task.robot())?;
        if n == 0 {
            bail!("at least one environment is needed");
        }
        let folder = self.folder(&system.name);
        let batch = Batch::new(&system, &system.scene(task.scene())?, n);
        let (solver, memory) = solver(self, &folder, &system, n, clock)?;
        let solver = Box::new(Timed(solver, clock.solver.clone()));
        let mut episodes = Episodes::new(task, Simulation { batch, solver }, seed);
        episodes.remember(memory);
        Ok(episodes)
    }
}

/// A solver, and how many frames back its next step depends on.
fn solver(arena: &Arena, folder: &Path, system: &Arc<System>, n: usize, clock: &Clock) -> Result<(Box<dyn Solver>, usize)> {
    Ok(match arena.solver {
        SolverName::Articulated => (Truth::Articulated.solver(system), 0),
        SolverName::Rapier => (Truth::Rapier.solver(system), 0),
        SolverName::Neural => {
            let model = Model::load(folder, system, None)?;
            let network = Timed(arena.device.network(&model.weights, n)?, clock.network.clone());
            let shape = model.config.network;
            (Box::new(Neural::new(model, system, Box::new(network))), shape.reach())
        }
    })
}
