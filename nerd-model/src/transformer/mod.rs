//! Networks: shapes, weights, and the engines of the CPU.

mod config;
mod forward;
mod packed;
mod stream;
mod weights;

pub use config::{Architecture, Init, MOST_PARAMETERS, Positions, TensorSpec, TransformerConfig};
pub(crate) use forward::check;
pub use forward::{Forward, ForwardError};
pub use packed::{PackedForward, PackedStream, packed};
pub use stream::{Stream, Windowed};
pub use weights::{Storage, Weights, WeightsError};
