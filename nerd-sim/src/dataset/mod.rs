//! Random trajectories and the shards that hold them.

mod begin;
mod config;
mod drive;
mod generate;
mod manifest;
mod part;
mod pilot;
mod recording;
mod shard;
mod smooth;

pub use begin::begin;
pub use config::GenerateConfig;
pub use drive::{Drive, Effort};
pub use generate::{generate, generate_part, record};
pub use manifest::Manifest;
pub use part::Part;
pub use pilot::{Act, Pilot};
pub use recording::{Recording, sha256_of};
pub use shard::{DatasetError, FORMAT, read_shard, write_shard};
pub use smooth::Smooth;
