//! Networks as lists of operations over slots, written once and executed by every engine.
//!
//! A slot is a matrix of activations with one row per token. Each step reads one slot and sets another, adds to it, or
//! changes it in place. So a residual connection is a slot that steps add to, and its gradient flows back through the
//! same slot. The module `networks` writes the lists beside their equations. `BurnNetwork` (feature `burn`) defines
//! each operation in burn. Tests compare the other engines with burn: outputs, and gradients with respect to weights
//! and inputs (module `specimens`).

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
