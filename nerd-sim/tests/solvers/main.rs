//! Common guarantees of every solver, gradients, rapier behind the trait, and instruments around solvers.

#[cfg(feature = "rapier")]
mod batches;
#[path = "../common/mod.rs"]
mod common;
mod energy;
mod gradients;
mod instruments;
#[cfg(feature = "rapier")]
mod rapier;
mod sticking;
