//! Options of a policy's simulator.

use nerd_train::{ppo::Arena, spec::SolverSpec, tell};

use crate::{
    options::MODELS,
    prelude::*,
    solvers::{choose_folder, device_of, spec},
};

#[derive(clap::Args)]
pub struct ArenaArgs {
    /// Solver: articulated, rapier or neural, with settings in brackets as in `rollout`
    #[arg(long, value_parser = spec, default_value = "articulated")]
    pub solver: SolverSpec,
    /// Folder of the model of `neural` [default: models/TASK if it exists, else models/ROBOT]
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Family of robots with drawn parameters, such as `ant-family`, or the path of a URDF whose TOML has `[vary]`.
    /// Each environment gets another robot, drawn by the seed [default: the task's robot]
    #[arg(long, value_name = "FAMILY")]
    pub family: Option<String>,
    /// Device of `neural` or `articulated`: cpu, cuda (NVIDIA GPU) or cuda-f32 (NVIDIA GPU with f32 matrix products)
    /// [default: cpu]
    #[arg(long, value_parser = word::<Device>(MODELS))]
    pub device: Option<Device>,
}

impl ArenaArgs {
    /// Makes the arena of a task; refuses options of `neural` with other solvers.
    pub fn of(self, task: &str) -> Result<Arena> {
        let mut spec = self.solver;
        match &mut spec {
            SolverSpec::Neural(own) => choose_folder(own, &self.model)?,
            _ => unused(&[("--model", self.model.is_some())], "without --solver neural")?,
        }
        if let Some(device) = self.device {
            if device.is_cuda() && matches!(spec, SolverSpec::Rapier(_)) {
                bail!("--device {device}: rapier is on the CPU; leave it out, or take --solver articulated");
            }
            let device = device_of(Some(device), spec.device())?;
            spec = spec.on(device);
        }
        if let Some(family) = self.family {
            if matches!(spec, SolverSpec::Neural(_)) {
                bail!(
                    "--family: robots that differ are stepped by `articulated` or `rapier`; leave --solver neural out"
                );
            }
            return Ok(Arena::family(task, &family, spec)?);
        }
        let robot = nerd_tasks::named(task)?;
        if robot.system()?.spec.vary.is_some() {
            tell!(
                "note: [vary] of `{0}` is not used here: --family {0} draws a robot for each environment",
                robot.robot()
            );
        }
        Ok(Arena::of(spec, &*robot)?)
    }
}
