//! Cables: their training through many frames, on the CPU and as kernels.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;
mod kernels;
mod rollouts;
