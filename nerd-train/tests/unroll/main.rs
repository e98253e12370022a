//! Training through many frames, on the CPU and as kernels: cables and robots.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;
mod kernels;
mod robots;
mod rollouts;

use common::*;
use nerd_model::chain::{Chain, ChainSolver, INPUTS, OUTPUTS, Rods};
use nerd_train::unroll::chain::{Cable, Loss, scales};
use nerd_train::unroll::{Body, Course, Place, UnrollLearner, motions, read};
