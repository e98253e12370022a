//! Numbers of the command line: what each may be, and what a command may ask of the machine, refused before work begins.
//!
//! `#[arg(long, value_parser = count(STARTS))]` refuses a value out of range with the option's name; [`memory`] and [`time`]
//! refuse what is bearable one by one and not together.

use std::ops::RangeInclusive;

use anyhow::Result;

pub use nerd_train::bounds::{FRAMES, SEEDS, STARTS, SUBSTEPS, TRANSITIONS};

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

/// A number that is not infinite.
pub fn finite(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| "a finite number is needed".into())
}

/// A number above zero that is not infinite.
pub fn positive(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|x| *x > 0.0).ok_or_else(|| "a finite number above 0 is needed".into())
}

/// [`nerd_train::bounds::memory`].
pub fn memory(factors: &[(&str, usize)], bytes: usize) -> Result<()> {
    Ok(nerd_train::bounds::memory(factors, bytes)?)
}

/// [`nerd_train::bounds::time`].
pub fn time(factors: &[(&str, usize)]) -> Result<()> {
    Ok(nerd_train::bounds::time(factors)?)
}

#[cfg(test)]
mod tests {
    use nerd_train::bounds::LAYERS;

    use super::*;

    #[test]
    fn a_number_is_within_its_range_or_the_range_is_said() {
        for (text, found) in [("1", Some(1)), ("64", Some(64)), ("0", None), ("65", None), ("-1", None), ("1e1", None), ("", None)] {
            assert_eq!(count::<usize>(LAYERS)(text).ok(), found, "{text}");
        }
        assert_eq!(count::<u64>(SEEDS)("18446744073709551615"), Err("a whole number from 0 to 9223372036854775807 is needed".into()));
        for text in ["nan", "inf", "-inf", "1e999", "x"] {
            assert!(finite(text).is_err() && positive(text).is_err() && within(0.0..=1.0)(text).is_err(), "{text}");
        }
        let share = within(0.0..=1.0);
        assert_eq!((share("1").ok(), share("1.1").ok(), positive("0").ok(), finite("-3").ok()), (Some(1.0), None, None, Some(-3.0)));
    }
}
