//! Generation of random trajectories, and the shards that store them.

mod begin;
mod config;
mod drive;
mod generate;
mod manifest;
mod shard;

pub use begin::begin;
pub use config::GenerateConfig;
pub use drive::{Act, Drive, Pilot, Smooth};
pub use generate::{generate, record};
pub use manifest::Manifest;
pub use shard::{DatasetError, FORMAT, read_shard, sha256_of, write_shard};
