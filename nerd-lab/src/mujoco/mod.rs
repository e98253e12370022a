//! MuJoCo as a referee and as a solver, for those who have one: a Python with MuJoCo is started when asked for.

mod python;
mod referee;
mod solver;
mod state;

pub use referee::{Referee, Scheme};
pub use solver::Mujoco;
pub use state::{from_mujoco, to_mujoco};
