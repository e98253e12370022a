//! The experiments that `cargo xtask measure NAME --set KEY=VALUE` makes.

use anyhow::{Result, bail};
use nerd_train::settings::{Given, Key, Settings};

use super::Experiment;

#[derive(Debug)]
pub struct Entry {
    pub name: &'static str,
    pub about: &'static str,
    pub keys: fn() -> Vec<&'static Key>,
    make: fn(&Given) -> Result<Box<dyn Experiment>>,
}

pub static REGISTRY: &[Entry] = &[
    entry::<super::carried::Carried>("carried", "Policies in MuJoCo by their ONNX and contract alone, beside the truth"),
    entry::<super::family::Family>("family", "Robots of a family beside models that are told or guess them, by the frames seen"),
    entry::<super::motions::Motions>("motions", "Errors of solvers along motions of a data set's kind that none has seen"),
    entry::<super::policies::Policies>(
        "policies",
        "Policies in the truth and in the model that learned it; with `fresh`, the strict protocol",
    ),
];

const fn entry<T: Settings + Experiment + 'static>(name: &'static str, about: &'static str) -> Entry {
    Entry { name, about, keys: T::keys, make: |given| Ok(Box::new(T::default().with(given).map_err(anyhow::Error::msg)?)) }
}

impl Entry {
    pub fn named(name: &str) -> Result<&'static Self> {
        match REGISTRY.iter().find(|entry| entry.name == name) {
            Some(entry) => Ok(entry),
            None => bail!("no experiment `{name}`: choose from {}", REGISTRY.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ")),
        }
    }

    /// The experiment with these settings, each `KEY=VALUE`.
    pub fn with(&self, set: &[String]) -> Result<Box<dyn Experiment>> {
        let mut given = Given::new();
        for text in set {
            let Some((name, value)) = text.split_once('=') else { bail!("--set {text}: KEY=VALUE is needed") };
            let keys = (self.keys)();
            let Some(key) = keys.iter().find(|key| key.name() == name) else {
                let known: Vec<String> = keys.iter().map(|key| key.name()).collect();
                bail!("--set {name}: settings of {} are {}", self.name, known.join(", "));
            };
            let value = key.values.parse(value).map_err(|needed| anyhow::anyhow!("--set {name}={value}: {needed}"))?;
            if given.insert(name.into(), value).is_some() {
                bail!("--set {name}: it is there twice");
            }
        }
        (self.make)(&given)
    }
}
