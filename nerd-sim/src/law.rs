//! Sampling laws written as text: `U(a, b)` with numbers like `3.5`, `-2pi`, `5pi/9`.

use rand::{Rng, RngExt};
use serde::Deserialize;

/// A uniform law on `[low, high)`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub struct Law {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Law {
    /// One draw.
    pub fn draw(&self, rng: &mut impl Rng) -> f64 {
        self.low + (self.high - self.low) * rng.random::<f64>()
    }
}

impl TryFrom<String> for Law {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let inner = text.trim().strip_prefix("U(").and_then(|t| t.strip_suffix(')'));
        let ends = inner.and_then(|t| t.split_once(','));
        let law = ends.and_then(|(low, high)| Some(Self { low: number(low)?, high: number(high)? }));
        law.filter(|l| l.low <= l.high).ok_or_else(|| format!("`{text}` is no law: write U(low, high), for example U(-pi, 2.5)"))
    }
}

/// A finite number, a multiple of pi, or a fraction of two such.
pub(crate) fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    let value = match (text.split_once('/'), text.strip_suffix("pi")) {
        (Some((a, b)), _) => number(a)? / number(b)?,
        (None, Some("")) => std::f64::consts::PI,
        (None, Some("-")) => -std::f64::consts::PI,
        (None, Some(k)) => k.parse::<f64>().ok()? * std::f64::consts::PI,
        (None, None) => text.parse().ok()?,
    };
    value.is_finite().then_some(value)
}
