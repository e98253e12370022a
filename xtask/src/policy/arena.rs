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
    /// Family of the task's robot, such as `ant-family`, or the path of a URDF whose TOML has `[vary]`: each environment gets one of its
    /// robots, drawn by the seed
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
                SolverName::Neural => {
                    bail!("--family: robots that differ are stepped by `articulated` or `rapier`; leave --solver neural out")
                }
            };
            return Ok(Arena::family(task, &family, truth, device)?);
        }
        let robot = nerd_tasks::named(task)?;
        if robot.system()?.spec.vary.is_some() {
            tell!("note: [vary] of `{0}` is not used here: --family {0} draws a robot for each environment", robot.robot());
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
