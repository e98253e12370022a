//! A system as MJCF, MuJoCo's own text, and MuJoCo as a referee for those who have one.

mod referee;
mod solver;
mod state;
mod text;

use std::path::PathBuf;

pub use referee::{GONE, Played, Referee, Scheme};
pub use solver::Mujoco;
pub use state::{from_mujoco, to_mujoco};
pub use text::mjcf;

/// Why a system cannot be written for MuJoCo, or MuJoCo gives no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MjcfError {
    /// The scene of this name holds what MuJoCo would need a mesh for.
    #[error("scene `{0}` is more than planes, boxes and cylinders; MuJoCo would need a mesh")]
    Scene(String),
    /// The robot's mass matrix is none; one line that says where.
    #[error("{0}")]
    Robot(String),
    /// The Python could not be started.
    #[error("cannot start `{}` as a Python with MuJoCo: {source}", python.display())]
    Start {
        /// The program that was to be started.
        python: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// What MuJoCo, or the Python that runs it, said in place of an answer.
    #[error("{0}")]
    Referee(String),
}
