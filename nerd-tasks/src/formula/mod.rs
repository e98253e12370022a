//! A task's arithmetic, written once as formulas on recorded numbers ([`Traced`]) that a [`Sight`] gives. [`Compiled`]
//! evaluates the record on the CPU, writes it as GPU kernels, and one adjoint sweep over it (`sweep.rs`) gives
//! gradients for both. `examples/backwards.rs` is such a task.

mod compiled;
mod forms;
mod gradients;
mod number;
mod program;
mod sight;
mod sweep;
mod tape;
mod text;

pub use compiled::Compiled;
pub use forms::Forms;
pub use number::Number;
pub(crate) use program::Program;
pub use sight::{Sight, rotation};
pub(crate) use tape::{Given, Leaf, Node};
pub use tape::{Tape, Traced};
