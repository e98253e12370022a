//! Where a policy acts, on the command line.

use std::path::PathBuf;

use anyhow::Result;
use nerd_sim::truth::Truth;
use nerd_tasks::named;

use crate::common::{DEVICES, Device, word};
use crate::flags::unused;
use crate::solvers::SolverName;

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
    /// The arena of a task; options of the learned solver are refused for another one.
    pub fn of(&self, task: &str) -> Result<nerd_train::ppo::Arena> {
        use nerd_train::ppo::Arena;
        if self.solver != SolverName::Neural {
            let given = [("--model", self.model.is_some()), ("--device", self.device != Device::Cpu)];
            unused(&given, "without --solver neural")?;
        }
        Ok(match self.solver {
            SolverName::Articulated => Arena::Truth(Truth::Articulated),
            SolverName::Rapier => Arena::Truth(Truth::Rapier),
            SolverName::Neural => Arena::Model { folder: self.folder(named(task)?.robot()), device: self.device },
        })
    }

    /// Folder of the model for a robot.
    pub fn folder(&self, robot: &str) -> PathBuf {
        self.model.clone().unwrap_or_else(|| nerd_train::shipped::model(Truth::Articulated, robot))
    }
}
