//! The number type of formulas.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or its text. Comparisons are numbers, too: 1 or 0.
pub trait Number:
    Copy + From<f64> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Square root.
    fn sqrt(self) -> Self;
    /// e to this.
    fn exp(self) -> Self;
    /// Without its sign.
    fn abs(self) -> Self;
    /// The larger of two.
    fn max(self, other: Self) -> Self;
    /// The smaller of two.
    fn min(self, other: Self) -> Self;
    /// An angle (rad) in [-pi, pi), as [`nerd_core::state::wrap`].
    fn wrap(self) -> Self;
    /// Whether it is less than another.
    fn below(self, other: Self) -> Self;

    /// Its square.
    fn squared(self) -> Self {
        self * self
    }

    /// Whether one of two is so.
    fn or(self, other: Self) -> Self {
        self.max(other)
    }
}

impl Number for f64 {
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    fn exp(self) -> Self {
        f64::exp(self)
    }

    fn abs(self) -> Self {
        f64::abs(self)
    }

    fn max(self, other: Self) -> Self {
        f64::max(self, other)
    }

    fn min(self, other: Self) -> Self {
        f64::min(self, other)
    }

    fn wrap(self) -> Self {
        nerd_core::state::wrap(self)
    }

    fn below(self, other: Self) -> Self {
        f64::from(u8::from(self < other))
    }
}
