//! Training through many frames, of cables with a token per rod ([`chain`]) and of robots with one token ([`robot`]).
//!
//! An update rolls motions out through H predicted frames and sums each frame's loss. Backpropagation passes through
//! network, features and step of all frames. Most rollouts of a cable continue where the last update ended, so that the
//! network trains on its own states. Rollouts far from the truth restart, and a random share of the others restarts
//! too. Rollouts of robots start from the truth in every update. Upstream gradients are limited ([`join`]). The option
//! `--sequence` sets H: 1 at first, more in later runs of a recipe.
//!
//! ```text
//! motions ── view (turned, mirrored) ──▶ rollouts ── pass ──▶ loss, gradient ──▶ Adam, Muon
//!                                           ▲ carried on
//! ```

mod body;
pub mod chain;
mod course;
#[cfg(feature = "cuda")]
mod cuda;
mod data;
mod learner;
mod pass;
pub mod robot;

use crate::learner::mismatch;
use crate::prelude::*;
use body::{bent, ratio};
use course::BETA;

pub use body::{Body, Place, join};
pub use course::Course;
#[cfg(feature = "cuda")]
pub use cuda::CudaUnrollLearner;
pub(crate) use data::sha256;
pub use data::{motions, read};
pub(crate) use learner::ROLLOUTS;
pub use learner::UnrollLearner;
pub use pass::{Rollout, Unroll};
