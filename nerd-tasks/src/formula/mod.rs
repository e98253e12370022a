//! Formulas on recorded numbers ([`Traced`]) that a [`Sight`] gives. [`crate::Compiled`] evaluates the record on the
//! CPU and writes it as GPU kernels. One adjoint sweep over the record (`sweep.rs`) gives the gradients for both.

mod forms;
mod number;
mod program;
mod sight;
mod sweep;
mod tape;

pub use forms::Forms;
pub(crate) use number::Function;
pub use number::Number;
pub(crate) use program::Program;
pub use sight::{Sight, rotation};
pub(crate) use sweep::{Ends, sweep};
pub(crate) use tape::{Given, Leaf, Node};
pub use tape::{Tape, Traced};
