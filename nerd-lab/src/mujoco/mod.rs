//! MuJoCo as an optional reference: a Python with MuJoCo is started on demand.

mod accelerations;
mod compiled;
pub mod player;
mod referee;
mod settings;
mod solver;
mod standing;

pub use accelerations::apart;
pub use compiled::{Compared, compare};
pub use referee::{Referee, Scheme, from_mujoco, to_mujoco};
pub use settings::Settings;
pub use solver::Mujoco;
pub use standing::stand;
