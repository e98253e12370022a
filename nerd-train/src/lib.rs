//! Training of NeRD models and evaluation of their rollouts.

pub mod learner;
pub mod windows;
