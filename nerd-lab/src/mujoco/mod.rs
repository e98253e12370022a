//! MuJoCo as a referee, for those who have one: a Python with MuJoCo is started when asked for.

mod accelerations;
pub mod player;
mod referee;

pub use accelerations::apart;
pub use referee::{Referee, Scheme, from_mujoco, to_mujoco};
