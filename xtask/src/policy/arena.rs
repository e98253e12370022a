//! Options for the simulator that a policy acts in.

use nerd_lab::experiments::games::{learned, truth_on};
use nerd_train::ppo::Arena;

use crate::{options::MODELS, prelude::*, solvers::SolverName};

#[derive(clap::Args, Clone, Debug)]
pub struct ArenaArgs {
    /// Solver: neural, or one of the truths, articulated (preset accurate) and rapier (4 steps)
    #[arg(long, value_enum, default_value_t = SolverName::Articulated)]
    pub solver: SolverName,
    /// Folder of the model of `neural` [default: models/TASK if it is there, else models/ROBOT]
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Family of the task's robot, as `ant-family`: in a truth, with one of its robots in each environment, drawn by the seed
    #[arg(long, value_name = "ROBOT")]
    pub family: Option<String>,
    /// Where `neural` or `articulated` is computed [default: cpu]
    #[arg(long, value_parser = word::<Device>(MODELS))]
    pub device: Option<Device>,
}

impl ArenaArgs {
    /// The arena of a task; options of the learned solver are refused for another one.
    pub fn of(self, task: &str) -> Result<Arena> {
        let device = self.device.unwrap_or_default();
        unused(&[("--model", self.model.is_some() && self.solver != SolverName::Neural)], "without --solver neural")?;
        if let Some(family) = self.family {
            let truth = match self.solver {
                SolverName::Articulated => Truth::Articulated,
                SolverName::Rapier => Truth::Rapier,
                SolverName::Neural => bail!("--family means nothing with --solver neural: its truth is articulated or rapier"),
            };
            if device.is_cuda() {
                bail!("--device {device}: robots that differ are on the CPU; leave it out");
            }
            return Ok(Arena::family(task, &family, truth)?);
        }
        match (self.solver, self.model) {
            (SolverName::Neural, Some(folder)) => Ok(Arena::Model { folder, device }),
            (SolverName::Neural, None) => learned(task, device),
            (SolverName::Articulated, _) => truth_on(device),
            (SolverName::Rapier, _) if device.is_cuda() => {
                bail!("--device {device}: rapier is on the CPU; leave it out, or take --solver articulated")
            }
            (SolverName::Rapier, _) => Ok(Arena::Truth(Truth::Rapier)),
        }
    }
}
