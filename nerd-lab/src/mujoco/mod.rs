//! MuJoCo beside our solvers: on charts, and in the stability suite.

mod referee;
mod solver;

pub use referee::{Referee, Scheme};
pub use solver::Mujoco;
