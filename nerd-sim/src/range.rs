//! Sampling ranges written as text: `U(a, b)` with numbers such as `3.5`, `-2pi`, `5pi/9`.

use std::{fmt, ops::RangeInclusive};

use rand::{Rng, RngExt};
use serde::{Deserialize, Deserializer, Serialize, de::Error};

/// A uniform distribution on `[low, high)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct Range {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Range {
    /// Draws a number from the range.
    pub fn draw(&self, rng: &mut impl Rng) -> f64 {
        self.low + (self.high - self.low) * rng.random::<f64>()
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // -0 + 0 is 0, so equal ranges have equal text.
        write!(f, "U({}, {})", self.low + 0.0, self.high + 0.0)
    }
}

impl From<Range> for String {
    fn from(range: Range) -> Self {
        range.to_string()
    }
}

impl TryFrom<String> for Range {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let inner = text.trim().strip_prefix("U(").and_then(|t| t.strip_suffix(')'));
        let ends = inner.and_then(|t| t.split_once(','));
        let range = ends.and_then(|(low, high)| Some(Self { low: number(low)?, high: number(high)? }));
        range.filter(|l| l.low <= l.high && (l.high - l.low).is_finite()).ok_or_else(|| {
            format!(
                "`{text}` is not a range: write U(low, high), the low end first, without units, for example U(-pi, 2.5)"
            )
        })
    }
}

/// A finite number, a multiple of pi, or a fraction of two of them.
pub(crate) fn number(text: &str) -> Option<f64> {
    let value = match text.split_once('/') {
        Some((above, below)) => multiple(above)? / multiple(below)?,
        None => multiple(text)?,
    };
    value.is_finite().then_some(value)
}

/// A number or a multiple of pi.
fn multiple(text: &str) -> Option<f64> {
    let text = text.trim();
    match text.strip_suffix("pi") {
        Some("") => Some(std::f64::consts::PI),
        Some("-") => Some(-std::f64::consts::PI),
        Some(factor) => Some(factor.parse::<f64>().ok()? * std::f64::consts::PI),
        None => text.parse().ok(),
    }
}

/// Refuses `x` outside `range`; the error names `key` and `unit`.
pub fn within(key: impl fmt::Display, x: f64, range: RangeInclusive<f64>, unit: &str) -> Result<(), String> {
    if range.contains(&x) {
        return Ok(());
    }
    let gap = if unit.is_empty() { "" } else { " " };
    Err(format!(
        "{key} is {}{gap}{unit}; a number from {} to {} is needed",
        short(x),
        short(*range.start()),
        short(*range.end())
    ))
}

fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e5).contains(&x.abs()) || x.abs() < 1e12 && x.fract() == 0.0 {
        x.to_string()
    } else {
        format!("{x:e}")
    }
}

/// Refuses a range with an end outside the bounds, or with its lower end above the upper end.
pub(crate) fn law(key: &str, law: &Range, range: RangeInclusive<f64>, unit: &str) -> Result<(), String> {
    if law.low > law.high {
        return Err(format!("{key} is {law}; its low end is above the high one"));
    }
    [law.low, law.high].iter().try_for_each(|end| within(format!("{key} is {law}; an end"), *end, range.clone(), unit))
}

/// Deserialises exactly N values: serde would ignore the rest of a longer list.
pub(crate) fn exactly<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    from: D,
) -> Result<[T; N], D::Error> {
    let values = Vec::<T>::deserialize(from)?;
    values.try_into().map_err(|found: Vec<T>| D::Error::custom(format!("{} values, {N} are needed", found.len())))
}
