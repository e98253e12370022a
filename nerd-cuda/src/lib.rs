//! A small layer over CUDA for kernels compiled at run time.
//!
//! The layer is for authors of kernels. Addresses, shapes and launch sizes are not checked: a wrong value makes a
//! kernel read or write other memory of the device. Work runs on two streams ([`Lane`]), each in order. Calls return a
//! [`DeviceError`] if the driver or a library fails.

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
pub use error::{DeviceError, DeviceResult};
pub use graph::Replay;
pub use memory::Buffer;
pub use precision::Precision;
pub use products::{Batch, Op};
