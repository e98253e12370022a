//! Options for the simulator that a policy acts in.

use nerd_lab::experiments::games::{learned, truth_on};
use nerd_train::ppo::Arena;
use nerd_train::shipped;

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
    /// robots, drawn by the seed. A model of a family (models/FAMILY, or --model) is first shown each robot until its episode begins
    #[arg(long, value_name = "ROBOT")]
    pub family: Option<String>,
    /// Frames of a robot that a model of a family is shown [default: 60]
    #[arg(long, value_parser = value::<u64>(Whole(1..=1_000_000)))]
    pub shown: Option<u64>,
    /// Folder of the policy that acts in those frames
    #[arg(long, value_name = "POLICY")]
    pub shown_by: Option<PathBuf>,
    /// Where `neural` or `articulated` is computed [default: cpu]
    #[arg(long, value_parser = word::<Device>(MODELS))]
    pub device: Option<Device>,
}

impl ArenaArgs {
    /// The arena of a task; options of the learned solver are refused for another one.
    pub fn of(self, task: &str) -> Result<Arena> {
        let device = self.device.unwrap_or_default();
        unused(&[("--model", self.model.is_some() && self.solver != SolverName::Neural)], "without --solver neural")?;
        let guessed = self.family.is_some() && self.solver == SolverName::Neural;
        let shown = [("--shown", self.shown.is_some() && !guessed), ("--shown-by", self.shown_by.is_some() && !guessed)];
        unused(&shown, "without --solver neural and --family")?;
        if let Some(family) = self.family {
            let truth = match self.solver {
                SolverName::Articulated => Truth::Articulated,
                SolverName::Rapier => Truth::Rapier,
                SolverName::Neural => {
                    if device != Device::Cpu {
                        bail!("--device {device}: a model that is shown its robots is on the CPU; leave it out");
                    }
                    let folder = self.model.unwrap_or_else(|| shipped::model_of_task(task, &family));
                    let Some(by) = self.shown_by else {
                        bail!("--shown-by POLICY is needed: who acts where a model of a family is shown robots")
                    };
                    return Ok(Arena::guess(task, &family, folder, by, self.shown.unwrap_or(60))?);
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
