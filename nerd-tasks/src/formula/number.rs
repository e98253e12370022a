//! The number type of formulas.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or a recorded one. Comparisons return numbers: 1 or 0.
pub trait Number:
    Copy
    + From<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Applies `function` to this number and `other`.
    #[doc(hidden)]
    fn made(self, function: Function, other: Self) -> Self;

    /// Square root.
    fn sqrt(self) -> Self {
        self.made(Function::Sqrt, 0.0.into())
    }

    /// Exponential, `e^x`.
    fn exp(self) -> Self {
        self.made(Function::Exp, 0.0.into())
    }

    /// Sine of an angle (rad).
    fn sin(self) -> Self {
        self.made(Function::Sin, 0.0.into())
    }

    /// Cosine of an angle (rad).
    fn cos(self) -> Self {
        self.made(Function::Cos, 0.0.into())
    }

    /// Absolute value.
    fn abs(self) -> Self {
        self.made(Function::Abs, 0.0.into())
    }

    /// The larger of two numbers.
    fn max(self, other: Self) -> Self {
        self.made(Function::Max, other)
    }

    /// The smaller of two numbers.
    fn min(self, other: Self) -> Self {
        self.made(Function::Min, other)
    }

    /// Wraps an angle (rad) to [-pi, pi), like [`nerd_core::state::wrap`].
    fn wrap(self) -> Self {
        self.made(Function::Wrap, 0.0.into())
    }

    /// 1 if this number is less than `other`, else 0.
    fn below(self, other: Self) -> Self {
        self.made(Function::Below, other)
    }

    /// Square.
    fn squared(self) -> Self {
        self * self
    }

    /// 1 if either of two conditions (1 or 0) holds, else 0.
    fn or(self, other: Self) -> Self {
        self.max(other)
    }
}

impl Number for f64 {
    #[inline]
    fn made(self, function: Function, other: Self) -> Self {
        match function {
            Function::Add => self + other,
            Function::Sub => self - other,
            Function::Mul => self * other,
            Function::Div => self / other,
            Function::Neg => -self,
            Function::Sqrt => f64::sqrt(self),
            Function::Exp => f64::exp(self),
            Function::Sin => f64::sin(self),
            Function::Cos => f64::cos(self),
            Function::Abs => f64::abs(self),
            Function::Max => f64::max(self, other),
            Function::Min => f64::min(self, other),
            Function::Wrap => nerd_core::state::wrap(self),
            Function::Below => f64::from(u8::from(self < other)),
        }
    }
}

/// Functions of one or two numbers; unary ones ignore the second.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    Add,
    Sub,
    Mul,
    Div,
    Neg,
    Sqrt,
    Exp,
    Sin,
    Cos,
    Abs,
    Max,
    Min,
    Wrap,
    Below,
}

/// Limit on the derivative of a square root, which is infinite at 0, for example for a distance of 0.
const STEEPEST: f64 = 1e12;

impl Function {
    /// Derivatives of the result y with respect to the arguments a and b; `None` where y does not depend on the
    /// argument. For equal arguments of max and min, the derivative with respect to the first is 1.
    pub(super) fn gradients<N: Number>(self, a: N, b: N, y: N) -> [Option<N>; 2] {
        let one = N::from(1.0);
        match self {
            Self::Add => [Some(one), Some(one)],
            Self::Sub => [Some(one), Some(-one)],
            Self::Mul => [Some(b), Some(a)],
            Self::Div => [Some(one / b), Some(-y / b)],
            Self::Neg => [Some(-one), None],
            Self::Sqrt => [Some((N::from(0.5) / y).min(N::from(STEEPEST))), None],
            Self::Exp => [Some(y), None],
            Self::Sin => [Some(a.cos()), None],
            Self::Cos => [Some(-a.sin()), None],
            Self::Abs => [Some(one - N::from(2.0) * a.below(N::from(0.0))), None],
            Self::Max => [Some(one - a.below(b)), Some(a.below(b))],
            Self::Min => [Some(one - b.below(a)), Some(b.below(a))],
            Self::Wrap => [Some(one), None],
            Self::Below => [None, None],
        }
    }
}
