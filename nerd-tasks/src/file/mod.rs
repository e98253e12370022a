//! Tasks as TOML files: observation, reward and end are expressions over named quantities of a robot, for any robot
//! that has them. A file is read for one robot to the same record as a task in Rust ([`crate::formula`]). So it runs on
//! CPU and GPU and has gradients. `docs/tasks.md` lists keys and words.

mod expression;
mod functions;
mod keys;
mod program;
mod task;
mod words;

pub use task::FileTask;
