//! Tasks by name.

use crate::{Ant, Anymal, CartpoleSwingup, FrankaReach, LeadTip, Task};

/// No such task.
#[derive(Debug, thiserror::Error)]
#[error("no task `{0}`: choose from {known}", known = names().join(", "))]
pub struct TaskError(pub String);

/// All of them, the paper's in the order of its table, then others.
fn all() -> [Box<dyn Task>; 10] {
    [
        Box::new(CartpoleSwingup),
        Box::new(FrankaReach::Position),
        Box::new(FrankaReach::Torque),
        Box::new(Ant::Run),
        Box::new(Ant::Spin),
        Box::new(Ant::SpinTrack),
        Box::new(Anymal::Forward),
        Box::new(Anymal::Side),
        Box::new(LeadTip),
        Box::new(Ant::Point),
    ]
}

/// Names of all tasks.
pub fn names() -> Vec<&'static str> {
    all().iter().map(|task| task.name()).collect()
}

/// A task by name.
///
/// # Errors
/// If there is none of that name.
pub fn named(name: &str) -> Result<Box<dyn Task>, TaskError> {
    all().into_iter().find(|task| task.name() == name).ok_or_else(|| TaskError(name.into()))
}
