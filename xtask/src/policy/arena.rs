//! Options for the simulator that a policy acts in.

use nerd_tasks::named;
use nerd_train::{ppo::Arena, shipped};

use crate::{options::MODELS, prelude::*, solvers::SolverName};

#[derive(clap::Args, Clone, Debug)]
pub struct ArenaArgs {
    /// Solver: neural, or one of the truths, articulated (preset accurate) and rapier (16 steps)
    #[arg(long, value_enum, default_value_t = SolverName::Articulated)]
    pub solver: SolverName,
    /// Folder of the model of `neural` [default: models/TASK if it is there, else models/ROBOT]
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Where `neural` or `articulated` is computed [default: cpu]
    #[arg(long, value_parser = word::<Device>(MODELS))]
    pub device: Option<Device>,
}

impl ArenaArgs {
    /// The arena of a task; options of the learned solver are refused for another one.
    pub fn of(self, task: &str) -> Result<Arena> {
        let device = self.device.unwrap_or_default();
        unused(&[("--model", self.model.is_some() && self.solver != SolverName::Neural)], "without --solver neural")?;
        match self.solver {
            SolverName::Neural => {
                let robot = named(task)?.robot();
                Ok(Arena::Model { folder: self.model.unwrap_or_else(|| shipped::model_of_task(task, robot)), device })
            }
            SolverName::Articulated if device.is_cuda() => on_card(),
            SolverName::Rapier if device.is_cuda() => {
                bail!("--device {device}: rapier is on the CPU; leave it out, or take --solver articulated")
            }
            SolverName::Articulated => Ok(Arena::Truth(Truth::Articulated)),
            SolverName::Rapier => Ok(Arena::Truth(Truth::Rapier)),
        }
    }
}

#[cfg(feature = "cuda")]
fn on_card() -> Result<Arena> {
    Ok(Arena::Card(nerd_model::pick::Setting::Accurate))
}

#[cfg(not(feature = "cuda"))]
fn on_card() -> Result<Arena> {
    bail!("--device cuda needs a build with `--features cuda`")
}
