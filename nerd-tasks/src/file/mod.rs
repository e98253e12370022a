//! Tasks as files: TOML whose observation, reward and end are expressions over named quantities of a robot, for any robot that has them.
//! They are read once, for one robot, to the same record as tasks in Rust ([`crate::formula`]). So they run on the CPU and on a GPU and
//! have gradients. `docs/tasks.md` lists keys and words.

mod expression;
mod functions;
mod keys;
mod program;
mod task;
mod words;

pub use task::FileTask;
