//! Solvers around a solver, and two that know no physics. Each is a [`Solver`](crate::solver::Solver) itself, so whatever takes
//! a solver takes it timed, recorded or shaken.
//!
//! ```
//! use nerd_sim::instruments::{Recorder, Replay, Shaken, Timed};
//! use nerd_sim::prelude::*;
//! let system = System::named("cartpole")?;
//! let scene = system.scene("free")?;
//! let solver = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
//! let mut timed = Timed::new(Recorder::new(Shaken::new(solver, 0.01, 7)));
//! let mut batch = Batch::new(&system, &scene, 3);
//! for _ in 0..10 {
//!     timed.step(&mut batch, &[0.0; 6])?;
//! }
//! println!("{:?} for ten frames of three environments", timed.spent);
//!
//! // The same states once more, without computing them.
//! let frames = timed.solver.frames;
//! let (mut replay, mut again) = (Replay::new(&frames), Batch::new(&system, &scene, 3));
//! for _ in 0..10 {
//!     replay.step(&mut again, &[0.0; 6])?;
//! }
//! assert_eq!(batch.states, again.states);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod around;
mod floors;
mod replay;

pub use around::{Recorder, Shaken, Timed};
pub use floors::{Glide, Hold, glide};
pub use replay::Replay;
