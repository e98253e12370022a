//! MuJoCo as a referee and as a solver, for those who have one: a Python with MuJoCo is started when asked for.

mod accelerations;
pub mod player;
mod referee;
mod solver;

pub use accelerations::apart;
pub use referee::{Referee, Scheme, from_mujoco, to_mujoco};
pub use solver::Mujoco;
