//! Limits of memory and time, checked before work begins.

use std::ops::RangeInclusive;

use indicatif::DecimalBytes;
use nerd_sim::files::memory::free;

use crate::prelude::*;

/// Bounds on the number of rollouts, trajectories, episodes or environments.
pub const STARTS: RangeInclusive<u64> = 1..=1_000_000;
/// Bounds on the frames of a rollout. A million frames of 1/60 s are 4.6 hours.
pub const FRAMES: RangeInclusive<u64> = 1..=1_000_000;
/// Bounds on the number of substeps in a frame.
pub const SUBSTEPS: RangeInclusive<u64> = 1..=10_000;
/// Bounds on the transitions in a data set (paper: ten million).
pub const TRANSITIONS: RangeInclusive<u64> = 1..=1_000_000_000;
/// Bounds on the optimiser updates of a run (paper: five million).
pub const UPDATES: RangeInclusive<u64> = 1..=1_000_000_000;
/// Bounds on the batch size: windows or sequences per update.
pub const BATCH: RangeInclusive<u64> = 1..=65_536;
/// Bounds on the number of network layers.
pub const LAYERS: RangeInclusive<u64> = 1..=64;
/// Bounds on the embedding width of a network.
pub const EMBEDDING: RangeInclusive<u64> = 1..=4096;
/// Bounds on a seed. JSON and TOML hold integers up to `i64::MAX`; seeds derived by addition still fit in a `u64`.
pub const SEEDS: RangeInclusive<u64> = 0..=i64::MAX as u64;

/// Longest run (minutes), about two years.
pub const MINUTES: f64 = 1e6;

/// Most substeps of a command, summed over its environments. At a microsecond each, they take about a day.
const WORK: u128 = 100_000_000_000;

/// Refuses work that needs more memory than is free. The need is `bytes` times the product of the values in `factors`
/// (option, value).
pub fn memory(factors: &[(&str, usize)], bytes: usize) -> Result<()> {
    let needed = product(factors).saturating_mul(bytes as u128);
    let free = u128::from(free());
    if needed > free {
        refuse!("{}: needs {} of memory, {} are free; ask for less", words(factors), size(needed), size(free));
    }
    Ok(())
}

/// Refuses work of more than a day. The product of `factors` (option, value) is the number of substeps.
pub fn time(factors: &[(&str, usize)]) -> Result<()> {
    let needed = product(factors);
    if needed > WORK {
        refuse!("{}: more than the {:.0e} substeps of a day's work; ask for less", words(factors), WORK as f64);
    }
    Ok(())
}

/// Refuses a list with a repeated name. The first argument names the list in the error.
pub fn once(whose: &str, names: &[String]) -> Result<()> {
    match (1..names.len()).find(|&k| names[..k].contains(&names[k])) {
        Some(k) => refuse!("{whose}: `{}` is named twice", names[k]),
        None => Ok(()),
    }
}

/// Refuses figures that are not finite, before they are written to a table. The first argument names the figure in the
/// error.
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
    factors.iter().map(|(option, n)| format!("{option} {n}")).join(" x ")
}

fn size(bytes: u128) -> DecimalBytes {
    DecimalBytes(u64::try_from(bytes).unwrap_or(u64::MAX))
}
