//! Tasks as formulas, written once for any kind of number: with f64 they are evaluated on the CPU, with recorded numbers the same steps
//! become a program for a GPU. So a task of one's own that is [`Formulas`] runs there like the built-in ones. Either has gradients: one
//! adjoint sweep over the recorded steps (`sweep.rs`), for numbers and for text.
//! `examples/backwards.rs` has one.

mod formulas;
mod number;
mod sight;
mod slopes;
mod sweep;
mod tape;
mod task;
mod text;

pub use formulas::Formulas;
pub use number::Number;
pub use sight::Sight;
pub(crate) use tape::{Given, Leaf, Node};
pub use tape::{Tape, Traced};
pub use text::written;
