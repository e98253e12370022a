//! Tasks as TOML files: observation, reward and end are expressions over named quantities of a robot, for any robot
//! that has them. A file is read for one robot into the same record of formulas as a task in Rust ([`crate::formula`]).
//! So a task from a file runs on CPU and GPU and has gradients. `docs/tasks.md` lists keys and words.

mod commands;
mod expression;
mod formulas;
mod functions;
mod keys;
mod program;
mod task;
mod words;

pub use task::FileTask;
