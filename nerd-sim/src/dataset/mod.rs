//! Random trajectories and the shards that hold them.

mod drive;
mod generate;
mod pilot;
mod recording;
mod shard;

pub use drive::Drive;
pub use generate::{GenerateConfig, Manifest, generate, record};
pub use pilot::{Act, Pilot};
pub use recording::{Recording, sha256_of};
pub use shard::{DatasetError, read_shard, write_shard};
