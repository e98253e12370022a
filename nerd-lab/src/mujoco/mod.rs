//! MuJoCo as a referee, for those who have one: a Python with MuJoCo is started when asked for.

mod accelerations;
mod compiled;
pub mod player;
mod referee;
mod settings;
mod standing;

pub use accelerations::apart;
pub use compiled::{Compared, compare};
pub use referee::{Referee, Scheme, from_mujoco, to_mujoco};
pub use settings::Settings;
pub use standing::stand;
