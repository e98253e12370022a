//! Common guarantees of every solver, rapier behind the trait, instruments around solvers, and the suite.

#[cfg(feature = "rapier")]
mod batches;
#[path = "../common/mod.rs"]
mod common;
mod energy;
mod instruments;
#[cfg(feature = "rapier")]
mod rapier;
mod slopes;
mod suite;
