//! Tasks as formulas, written once for any kind of number: with f64 they are what the CPU reckons, with [`Text`] the same steps are written
//! down as a program for a graphics card. So a task of one's own that is [`Formulas`] runs there like the built-in ones.
//! `examples/backwards.rs` has one.

mod formulas;
mod number;
mod sight;
mod task;
mod text;

pub use formulas::Formulas;
pub use number::Number;
pub use sight::Sight;
pub use text::{Tape, Text, written};
