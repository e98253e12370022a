//! Training of chains ([`nerd_model::chain`]) through many frames.
//!
//! An update rolls chains out through H predicted frames, sums each frame's loss, and back-propagates through all of them: network,
//! features and step. Most rollouts continue where the last update ended, so that the network trains on its own states; a chain that is
//! too far off restarts, and so do some at random. Gradients through many frames are limited ([`join`]). H is `--sequence`: 1 at first,
//! more in the later runs of a recipe.
//!
//! ```text
//! motions ── view (turned, mirrored) ──▶ rollouts ── unroll ──▶ loss, gradient ──▶ Adam
//!                                           ▲ carried on
//! ```

mod course;
#[cfg(feature = "cuda")]
mod cuda;
mod data;
pub mod device;
mod judge;
mod learner;
mod loss;
mod scales;
mod unroll;
mod view;

pub use course::Course;
#[cfg(feature = "cuda")]
pub use cuda::CudaChainLearner;
pub use data::Motions;
pub use judge::distance;
pub use learner::ChainLearner;
pub(crate) use learner::ROLLOUTS;
pub use loss::Loss;
pub use scales::scales;
pub use unroll::{Rollout, Unroll, frame_back, join};
pub use view::View;
