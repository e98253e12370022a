//! Motions as pages that any browser plays. [`episode`] shows an episode of a policy, of a task of one's own, too.

mod game;
mod page;
mod solids;

pub use game::{episode, record};
pub use page::{Replay, Track};
pub use solids::Solid;
// For pages that hold several.
#[doc(hidden)]
pub use page::{SCRIPT, escape, script};
