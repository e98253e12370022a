//! A network as a list of operations over named slots, written once and read by every engine.
//!
//! A slot holds a row for each token. Each step reads one slot and sets another, adds to it, or changes it in place. So a residual
//! connection is a slot that is added to, and its gradient flows back through the same slot. The module `networks` writes the lists beside
//! their equations. `BurnNetwork` (feature `burn`) defines each operation in burn, and the other engines are tested against it: outputs,
//! gradients with respect to weights and inputs (module `specimens`).

#[cfg(feature = "burn")]
mod burn;
pub(crate) mod config;
pub mod cpu;
mod networks;
pub(crate) mod op;
#[cfg(feature = "burn")]
pub mod specimens;

#[cfg(feature = "burn")]
pub use self::burn::BurnNetwork;
pub use networks::policy;
pub use op::{Activation, Init, Op, Program, Slot, Step, TensorSpec, Weight};
