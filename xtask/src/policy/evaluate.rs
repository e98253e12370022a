//! `cargo xtask policy evaluate --policy models/policies/cartpole-swingup-neural-200`: the paper's protocol, 2048 games under mean
//! actions, in the truth and in the simulator that learned it.

use anyhow::Result;
use nerd_lab::experiments::policies::Policies;

use crate::conduct::ConductArgs;

/// Play policies in the truth and in the learned simulator.
#[derive(clap::Args, Clone, Debug)]
pub struct EvaluateArgs {
    #[command(flatten)]
    pub of: ConductArgs<Policies>,
}

/// Runs the verb.
pub fn run(args: EvaluateArgs) -> Result<()> {
    args.of.try_out()
}
