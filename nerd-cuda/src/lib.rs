//! A small layer over CUDA for kernels that are compiled at run time.
//!
//! It is for authors of kernels. Addresses, shapes and sizes of launches and products are not checked, and a wrong one reads or writes
//! other memory of the device. Work runs on two streams ([`Lane`]), each in order. Every call returns a [`DeviceError`] if the driver or a
//! library fails.

mod beside;
mod compile;
mod device;
mod error;
mod graph;
mod memory;
mod precision;
mod products;

pub use beside::Beside;
pub use cudarc::driver::CudaEvent as Event;
pub use device::{Arg, Device, Extent, Foreseen, Lane};
pub use error::DeviceError;
pub use graph::Replay;
pub use memory::Buffer;
pub use precision::Precision;
pub use products::{Batch, Op};
