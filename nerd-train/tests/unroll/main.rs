//! Training through many frames, on the CPU and as kernels: cables and robots.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;
mod kernels;
mod robots;
mod rollouts;
