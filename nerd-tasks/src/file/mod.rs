//! Tasks as files: TOML whose observation, reward and end are expressions over named quantities of a robot, for any robot that has them.
//! They are read once, for one robot, to the record that tasks in Rust are written down as ([`crate::formula`]), so they run on the CPU
//! and on a GPU and have slopes. `docs/tasks.md` has keys and words.

mod expression;
mod functions;
mod keys;
mod program;
mod task;
mod words;

pub use task::FileTask;
