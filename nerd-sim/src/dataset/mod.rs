//! Random trajectories and the shards that hold them.

mod begin;
mod config;
mod drive;
mod generate;
mod manifest;
mod recording;
mod shard;

pub use begin::begin;
pub use config::{GenerateConfig, Part};
pub use drive::{Act, Drive, Pilot, Smooth};
pub use generate::{generate, generate_part, record};
pub use manifest::Manifest;
pub use recording::{Recording, sha256_of};
pub use shard::{DatasetError, FORMAT, read_shard, write_shard};
