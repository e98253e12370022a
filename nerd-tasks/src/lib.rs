//! Tasks: what a policy sees, does, is rewarded for, and when an episode ends. A task knows a robot and no solver, so
//! swapping the solver changes no line here. Words are Gymnasium's.

mod cartpole_swingup;
mod registry;
mod task;

pub use cartpole_swingup::CartpoleSwingup;
pub use registry::{TaskError, named, names};
pub use task::{Episodes, StepResult, Task};
