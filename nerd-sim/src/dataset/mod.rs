//! Random trajectories and the shards that hold them.

mod generate;
mod recording;
mod shard;

pub use generate::{GenerateConfig, Manifest, generate, record};
pub use recording::Recording;
pub use shard::{DatasetError, read_shard, write_shard};
