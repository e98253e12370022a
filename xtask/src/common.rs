//! Options and small things every verb shares.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::de::DeserializeOwned;
use serde::de::IntoDeserializer;
use serde::de::value::{Error, StringDeserializer};

pub use nerd_train::device::Device;
pub use nerd_train::progress::bar;

/// One of some words, for the setting of a library that they name.
pub fn word<T: DeserializeOwned + Clone + Send + Sync + 'static>(words: &'static [&'static str]) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(words)
        .try_map(|word| T::deserialize(IntoDeserializer::<Error>::into_deserializer(word) as StringDeserializer<Error>))
}

/// Words for [`Device`].
pub const DEVICES: &[&str] = Device::WORDS;
/// Words for [`nerd_sim::truth::Truth`].
pub const TRUTHS: &[&str] = &["articulated", "paper", "rapier"];
