//! PPO and SHAC: learning, policies and their folders, policies in data, the kernels of rollouts.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;
#[path = "../../../nerd-sim/tests/common/differences.rs"]
mod differences;
mod file;
mod gradients;
mod kernels;
mod lead;
mod learning;
mod onnx;
mod pilot;
mod policy;
mod shac;

use common::*;
use nerd_tasks::{Episodes, named};
use nerd_train::ppo::Shape;
use nerd_train::ppo::*;

/// Small settings, overridden by `text`.
fn config(text: &str) -> PpoConfig {
    let usual = "environments = 16\nhorizon = 16\niterations = 10\nminibatch = 128\nepochs = 4\nhidden = [16]\n";
    PpoConfig::from_text(&format!("{usual}{text}")).expect("good settings")
}

fn policy(observation: usize, stack: usize, action: usize, hidden: &[usize], activation: Activation) -> Policy {
    let shape = Shape { observation, stack, action, hidden: hidden.into(), activation, state_dependent_std: false };
    Policy::new(shape, &mut stream(1, 0))
}

/// Episodes on the reference's preset, or of the lead at one implicit substep.
fn episodes(task: &str, n: usize, seed: u64) -> Episodes {
    let arena = if task == "lead-tip" { Arena::Solver(SolverSpec::implicit(1)) } else { Truth::Paper.into() };
    arena.episodes(task, n, seed).expect("episodes")
}
