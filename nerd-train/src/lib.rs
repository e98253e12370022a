//! Training of NeRD models and evaluation of their rollouts.

pub mod checkpoint;
pub mod evaluate;
pub mod learner;
pub mod metrics;
pub mod prepare;
pub mod report;
pub mod schedule;
pub mod supply;
pub mod trainer;
pub mod windows;
