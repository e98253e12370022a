//! What every solver promises, what rapier must do behind the trait, instruments around solvers, and the suite.

#[cfg(feature = "rapier")]
mod batches;
#[path = "../common/mod.rs"]
mod common;
mod instruments;
#[cfg(feature = "rapier")]
mod rapier;
mod slopes;
mod suite;
