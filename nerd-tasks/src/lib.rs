#![doc = include_str!("../README.md")]

mod compiled;
mod drape;
mod episodes;
mod error;
mod file;
pub mod formula;
mod lead_tip;
mod registry;
mod snapshot;
mod step;
mod task;

pub use compiled::{Compiled, fast_start};
pub use episodes::Episodes;
pub use error::TaskError;
pub use file::FileTask;
pub use lead_tip::LeadTip;
pub use registry::{general, named, names, parts, word};
pub use snapshot::{Snapshot, Trace};
pub use step::StepResult;
pub use task::{About, Plain, Task, View, Work};

pub use nerd_sim;
pub use rand;
pub use rand_chacha::ChaCha8Rng;
