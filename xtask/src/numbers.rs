//! Numbers of the command line: what each may be, and what a command may ask of the machine, refused before work begins.
//!
//! `#[arg(long, value_parser = count(STARTS))]` refuses a value out of range with the option's name; [`memory`] and [`time`]
//! refuse what is bearable one by one and not together.

use std::ops::RangeInclusive;

use anyhow::{Result, bail};

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

/// Substeps of all environments that a command may ask for: at a microsecond each, a day.
const WORK: u128 = 100_000_000_000;
/// Memory of a machine that does not say what it has (bytes).
const MEMORY: u64 = 8 << 30;

/// A whole number within a range.
pub fn count<T: TryFrom<u64>>(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.parse().ok().filter(|n| range.contains(n)).and_then(|n| T::try_from(n).ok());
        number.ok_or_else(|| format!("a whole number from {} to {} is needed", range.start(), range.end()))
    }
}

/// A number within a range.
pub fn within(range: RangeInclusive<f64>) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.parse().ok().filter(|x| range.contains(x));
        number.ok_or_else(|| format!("a number from {} to {} is needed", range.start(), range.end()))
    }
}

/// A part of a whole.
pub fn share(text: &str) -> Result<f64, String> {
    within(0.0..=1.0)(text)
}

/// A number that is not infinite.
pub fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| "a finite number is needed".into())
}

/// A number above zero that is not infinite.
pub fn positive(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|x| *x > 0.0).ok_or_else(|| "a finite number above 0 is needed".into())
}

/// Refuses what needs more memory than there is: `bytes` for every combination of `factors`, options with their values.
pub fn memory(factors: &[(&str, usize)], bytes: usize) -> Result<()> {
    let (needed, free) = (product(factors).saturating_mul(bytes as u128), u128::from(free()));
    if needed > free {
        bail!("{}: needs {} of memory, {} are free; ask for less", words(factors), size(needed), size(free));
    }
    Ok(())
}

/// Refuses what takes longer than a day: `factors` are options with their values, whose product is substeps.
pub fn time(factors: &[(&str, usize)]) -> Result<()> {
    let needed = product(factors);
    if needed > WORK {
        bail!("{}: more than the {:.0e} substeps of a day's work; ask for less", words(factors), WORK as f64);
    }
    Ok(())
}

/// Refuses a figure that is no number, which would stand in a table like any other; `whose` says which it is.
pub fn figures<'a>(whose: &str, figures: impl IntoIterator<Item = &'a f64>) -> Result<()> {
    match figures.into_iter().find(|x| !x.is_finite()) {
        Some(x) => bail!("{whose} is {x}: no result is written"),
        None => Ok(()),
    }
}

fn product(factors: &[(&str, usize)]) -> u128 {
    factors.iter().fold(1, |all: u128, (_, n)| all.saturating_mul(*n as u128))
}

fn words(factors: &[(&str, usize)]) -> String {
    factors.iter().map(|(option, n)| format!("{option} {n}")).collect::<Vec<_>>().join(" x ")
}

fn size(bytes: u128) -> String {
    let units = ["B", "kB", "MB", "GB", "TB", "PB"];
    let power = (bytes.max(1).ilog10() / 3).min(units.len() as u32 - 1);
    format!("{:.1} {}", bytes as f64 / 1000f64.powi(power as i32), units[power as usize])
}

/// Memory that this process may still have (bytes): the least of what the machine, its container and a `ulimit` say.
fn free() -> u64 {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let field = |text: &str, name: &str| text.lines().find_map(|l| l.strip_prefix(name)?.split_whitespace().next()?.parse::<u64>().ok());
    let machine = field(&read("/proc/meminfo"), "MemAvailable:").map(|kib| kib.saturating_mul(1024));
    let container = read("/sys/fs/cgroup/memory.max").trim().parse().ok();
    let process = field(&read("/proc/self/limits"), "Max address space");
    [machine, container, process].into_iter().flatten().min().unwrap_or(MEMORY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_within_its_range_or_the_range_is_said() {
        for (text, found) in [("1", Some(1)), ("64", Some(64)), ("0", None), ("65", None), ("-1", None), ("1e1", None), ("", None)] {
            assert_eq!(count::<usize>(LAYERS)(text).ok(), found, "{text}");
        }
        assert_eq!(count::<u64>(SEEDS)("18446744073709551615"), Err("a whole number from 0 to 9223372036854775807 is needed".into()));
        for text in ["nan", "inf", "-inf", "1e999", "x"] {
            assert!(finite(text).is_err() && positive(text).is_err() && share(text).is_err(), "{text}");
        }
        assert_eq!((share("1").ok(), share("1.1").ok(), positive("0").ok(), finite("-3").ok()), (Some(1.0), None, None, Some(-3.0)));
    }

    #[test]
    fn products_are_refused_before_they_overflow() {
        let most = usize::MAX;
        assert!(memory(&[("--starts", 16), ("--steps", 100)], 8).is_ok());
        let said = memory(&[("--starts", most), ("--steps", most), ("--envs", most)], most).expect_err("too much").to_string();
        assert!(said.starts_with("--starts 18446744073709551615 x --steps") && said.contains("PB of memory"), "{said}");
        assert!(time(&[("--starts", 2048), ("--steps", 1000), ("--substeps", 128)]).is_ok());
        assert!(time(&[("--starts", 1_000_000), ("--steps", 1_000_000)]).is_err());
    }
}
