//! Training of NeRD models and evaluation of their rollouts.

pub mod evaluate;
pub mod learner;
pub mod prepare;
pub mod windows;
