//! A process's rank, from the variables that `torchrun` sets and other launchers can set.

use crate::error::part;

/// Most ranks of a run.
const WORLD: usize = 4096;

/// Set by `torchrun` where it holds the port itself.
const TAKEN: &str = "TORCHELASTIC_USE_AGENT_STORE";

/// Why ranks cannot work together any more: a variable that is wrong, one that did not come, is lost, or does something else. One line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct RankError(pub String);

part!(RankError);

/// A process among those of its run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// Its number, from 0.
    pub rank: usize,
    /// How many there are.
    pub world: usize,
    /// Its number on its machine, from 0.
    pub local: usize,
    /// Where rank 0 is: a name or an address.
    pub address: String,
    /// On which port it listens.
    pub port: u16,
}

impl Default for Place {
    fn default() -> Self {
        Self { rank: 0, world: 1, local: 0, address: "127.0.0.1".into(), port: 0 }
    }
}

impl Place {
    /// That of this process; alone, where neither `RANK` nor `WORLD_SIZE` is set.
    pub fn here() -> Result<Self, RankError> {
        Self::of(|name| std::env::var_os(name).map(|value| value.to_string_lossy().into_owned()))
    }

    /// That of these variables.
    pub fn of(variable: impl Fn(&str) -> Option<String>) -> Result<Self, RankError> {
        if variable("RANK").is_none() && variable("WORLD_SIZE").is_none() {
            return Ok(Self::default());
        }
        let text = |name: &str, needed: &str| {
            let others = "RANK, WORLD_SIZE, LOCAL_RANK, MASTER_ADDR and MASTER_PORT are set for each process, as torchrun does, or none";
            let missing = || RankError(format!("{name} is not set: {needed} is needed; {others}"));
            variable(name).filter(|value| !value.is_empty()).ok_or_else(missing)
        };
        let whole = |name: &str, least: usize, most: usize| {
            let needed = format!("a whole number from {least} to {most}");
            let value = text(name, &needed)?;
            let number = value.parse().ok().filter(|n| (least..=most).contains(n));
            number.ok_or_else(|| RankError(format!("{name} is `{value}`: {needed} is needed")))
        };
        let world = whole("WORLD_SIZE", 1, WORLD)?;
        let rank = whole("RANK", 0, world - 1)?;
        if world == 1 {
            return Ok(Self::default());
        }
        let local = whole("LOCAL_RANK", 0, rank)?;
        let address = text("MASTER_ADDR", "the name or address of the machine of rank 0")?;
        let port = whole("MASTER_PORT", 1, usize::from(u16::MAX) - 1)? as u16;
        // Where torchrun itself listens there, the next port is ours.
        let taken = variable(TAKEN).is_some_and(|value| value == "True");
        Ok(Self { rank, world, local, address, port: port + u16::from(taken) })
    }
}

/// Numbers as bytes, as they are sent.
pub fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Bytes as numbers.
pub fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|x| f32::from_le_bytes(*x)).collect()
}
