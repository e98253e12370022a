#![doc = include_str!("../README.md")]

pub mod around;
pub mod base;
pub mod chain;
pub mod device;
pub mod features;
pub mod folder;
pub mod form;
mod frame;
pub mod gradients;
pub mod neural;
pub mod normalizer;
pub mod program;
pub mod solver;
pub mod transformer;
pub mod trapezoid;

/// Device of burn: `BurnDevice::flex()` is the CPU.
#[cfg(feature = "burn")]
pub use burn::tensor::Device as BurnDevice;
pub use nerd_sim;

/// Names that most programs need.
pub mod prelude {
    pub use nerd_sim::prelude::*;

    pub use crate::folder::Model;
    pub use crate::neural::Neural;
}
