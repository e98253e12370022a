//! `cargo xtask policy evaluate --policy models/policies/cartpole-swingup-neural-0`: the paper's protocol, 2048 games under mean
//! actions, in the truth and in the simulator that learned it.

use anyhow::{Result, bail};
use nerd_train::experiments::policies::Policies;
use nerd_train::ppo::folder;

use crate::conduct::ConductArgs;

/// Play policies in the truth and in the learned simulator.
#[derive(clap::Args, Clone, Debug)]
pub struct EvaluateArgs {
    /// Task [default: the policy's]
    pub task: Option<String>,
    #[command(flatten)]
    pub of: ConductArgs<Policies>,
}

/// Runs the verb.
pub fn run(args: EvaluateArgs) -> Result<()> {
    if let Some(task) = &args.task {
        nerd_tasks::named(task)?;
        for policy in args.of.settings()?.folders()? {
            let found = folder::load(&policy)?.0.task;
            if found != *task {
                bail!("{} is a policy of `{found}`, not of `{task}`", policy.display());
            }
        }
    }
    args.of.try_out()
}
