//! Options and small things every verb shares.

use anyhow::{Context, Result};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::de::DeserializeOwned;
use serde::de::IntoDeserializer;
use serde::de::value::{Error, StringDeserializer};
use std::path::{Path, PathBuf};

pub use nerd_train::device::Device;
pub use nerd_train::progress::bar;

/// One of some words, for the setting of a library that they name.
pub fn word<T: DeserializeOwned + Clone + Send + Sync + 'static>(words: &'static [&'static str]) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(words)
        .try_map(|word| T::deserialize(IntoDeserializer::<Error>::into_deserializer(word) as StringDeserializer<Error>))
}

/// Words for [`Device`].
pub const DEVICES: &[&str] = &["cpu", "cuda"];
/// Words for [`nerd_sim::truth::Truth`].
pub const TRUTHS: &[&str] = &["articulated", "rapier"];

/// Folders in one, by their names' beginning, in order; none if it is not there.
pub fn folders(of: &Path, prefix: &str) -> Result<Vec<PathBuf>> {
    if !of.exists() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(of).with_context(|| format!("cannot read {}", of.display()))?;
    let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(|p| p.join("config.json").exists()).collect();
    found.retain(|p| p.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix)));
    found.sort();
    Ok(found)
}
