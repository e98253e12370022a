//! Training of NeRD models, evaluation of their rollouts, and policies learned on any solver.

pub mod best;
pub mod checkpoint;
pub mod difference;
pub mod evaluate;
pub mod learner;
pub mod metrics;
pub mod ppo;
pub mod prepare;
mod product;
pub mod ranges;
pub mod report;
pub mod schedule;
pub mod supply;
pub mod trainer;
pub mod windows;
