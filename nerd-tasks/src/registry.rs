//! Tasks by name.

use crate::{CartpoleSwingup, Task};

/// No such task.
#[derive(Debug, thiserror::Error)]
#[error("no task `{0}`: known are {known}", known = names().join(", "))]
pub struct TaskError(pub String);

type Make = fn() -> Box<dyn Task>;

const TASKS: [(&str, Make); 1] = [("cartpole-swingup", || Box::new(CartpoleSwingup))];

/// Names of all tasks.
pub fn names() -> Vec<&'static str> {
    TASKS.iter().map(|t| t.0).collect()
}

/// A task by name.
pub fn named(name: &str) -> Result<Box<dyn Task>, TaskError> {
    TASKS.iter().find(|t| t.0 == name).map(|t| t.1()).ok_or_else(|| TaskError(name.into()))
}
