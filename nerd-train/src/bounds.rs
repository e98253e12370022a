//! Limits of memory and time: what exceeds them is refused before work begins.

use std::ops::RangeInclusive;

use indicatif::DecimalBytes;
use nerd_sim::files::memory::free;

use crate::prelude::*;

/// Rollouts, trajectories, games, environments.
pub const STARTS: RangeInclusive<u64> = 1..=1_000_000;
/// Frames of a rollout: at 1/60 s, four and a half hours.
pub const FRAMES: RangeInclusive<u64> = 1..=1_000_000;
/// Substeps of a frame.
pub const SUBSTEPS: RangeInclusive<u64> = 1..=10_000;
/// Transitions of a data set: the paper has ten million.
pub const TRANSITIONS: RangeInclusive<u64> = 1..=1_000_000_000;
/// Optimiser updates: the paper has five million.
pub const UPDATES: RangeInclusive<u64> = 1..=1_000_000_000;
/// Windows or sequences in an update.
pub const BATCH: RangeInclusive<u64> = 1..=65_536;
/// Layers of a network.
pub const LAYERS: RangeInclusive<u64> = 1..=64;
/// Width of a network.
pub const EMBEDDING: RangeInclusive<u64> = 1..=4096;
/// Seeds: what JSON and TOML hold, and some more for the seeds that are made of them.
pub const SEEDS: RangeInclusive<u64> = 0..=i64::MAX as u64;

/// Minutes: two years.
pub const MINUTES: f64 = 1e6;

/// Substeps of all environments that a command may ask for: at a microsecond each, a day.
const WORK: u128 = 100_000_000_000;

/// Refuses what needs more memory than there is: `bytes` for every combination of `factors`, options with their values.
pub fn memory(factors: &[(&str, usize)], bytes: usize) -> Result<()> {
    let (needed, free) = (product(factors).saturating_mul(bytes as u128), u128::from(free()));
    if needed > free {
        refuse!("{}: needs {} of memory, {} are free; ask for less", words(factors), size(needed), size(free));
    }
    Ok(())
}

/// Refuses what takes longer than a day: `factors` are options with their values, whose product is substeps.
pub fn time(factors: &[(&str, usize)]) -> Result<()> {
    let needed = product(factors);
    if needed > WORK {
        refuse!("{}: more than the {:.0e} substeps of a day's work; ask for less", words(factors), WORK as f64);
    }
    Ok(())
}

/// Refuses what a list has twice; `whose` names the list.
pub fn once(whose: &str, names: &[String]) -> Result<()> {
    match (1..names.len()).find(|&k| names[..k].contains(&names[k])) {
        Some(k) => refuse!("{whose}: `{}` is named twice", names[k]),
        None => Ok(()),
    }
}

/// Refuses NaN, which would be in a table like any other figure; `whose` names it.
pub fn figures<'a>(whose: &str, figures: impl IntoIterator<Item = &'a f64>) -> Result<()> {
    match figures.into_iter().find(|x| !x.is_finite()) {
        Some(x) => refuse!("{whose} is {x}: no result is written"),
        None => Ok(()),
    }
}

fn product(factors: &[(&str, usize)]) -> u128 {
    factors.iter().fold(1, |all: u128, (_, n)| all.saturating_mul(*n as u128))
}

fn words(factors: &[(&str, usize)]) -> String {
    factors.iter().map(|(option, n)| format!("{option} {n}")).collect::<Vec<_>>().join(" x ")
}

fn size(bytes: u128) -> DecimalBytes {
    DecimalBytes(u64::try_from(bytes).unwrap_or(u64::MAX))
}
