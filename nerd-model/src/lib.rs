#![doc = include_str!("../README.md")]

pub mod around;
pub mod base;
pub mod chain;
pub mod device;
pub mod features;
pub mod folder;
pub mod form;
mod frame;
pub mod neural;
pub mod normalizer;
pub mod pick;
pub mod program;
pub mod slopes;
pub mod transformer;
pub mod trapezoid;

/// Where burn computes: `BurnDevice::flex()`, the CPU.
#[cfg(feature = "burn")]
pub use burn::tensor::Device as BurnDevice;
pub use nerd_sim;

/// What most programs need.
pub mod prelude {
    pub use nerd_sim::prelude::*;

    pub use crate::folder::Model;
    pub use crate::neural::Neural;
}
