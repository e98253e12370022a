//! MuJoCo as an optional reference: a Python with MuJoCo is started on demand.

mod accelerations;
mod compiled;
pub mod player;
mod python;
mod settings;
mod standing;
mod states;

pub use accelerations::apart;
pub use compiled::{Compared, compare};
pub use python::{Python, REFEREE};
pub use settings::Settings;
pub use standing::stand;
pub use states::{all_to_mujoco, from_mujoco, take, to_mujoco};
