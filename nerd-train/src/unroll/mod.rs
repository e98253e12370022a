//! Training through many frames: cables, whose tokens are their rods ([`chain`]), and robots seen by one token ([`robot`]).
//!
//! An update rolls motions out through H predicted frames, sums each frame's loss, and back-propagates through all of them: network,
//! features and step. Most rollouts of a cable continue where the last update ended, so that the network trains on its own states; one
//! that is too far off restarts, and so do some at random. Those of robots begin on the truth in every update. Gradients through many frames are limited ([`join`]). H is `--sequence`: 1 at first,
//! more in the later runs of a recipe.
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

use crate::prelude::*;
use body::bent;
use course::BETA;

pub use body::{Body, Place, join};
pub use course::Course;
#[cfg(feature = "cuda")]
pub use cuda::CudaUnrollLearner;
pub use data::Motions;
pub(crate) use learner::ROLLOUTS;
pub use learner::UnrollLearner;
pub use pass::{Rollout, Unroll};
