//! Activations in f32, written so that the compiler makes vectors of them at the width `pulp` finds at run time. What is no
//! number stays none.

use pulp::Arch;
use serde::{Deserialize, Serialize};

/// What stands between two layers. Each is differentiated from its value y.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// `tanh x`, slope `1 - y^2`.
    #[default]
    Tanh,
    /// `max(x, 0)`, slope 1 where y > 0.
    Relu,
    /// `x`, below 0 `e^x - 1`; slope 1, below 0 `y + 1`.
    Elu,
}

impl Activation {
    /// Replaces x by y.
    pub fn apply(self, x: &mut [f32]) {
        Arch::new().dispatch(|| match self {
            Self::Tanh => x.iter_mut().for_each(|x| *x = tanh(*x)),
            Self::Relu => x.iter_mut().for_each(|x| *x = above(*x)),
            Self::Elu => x.iter_mut().for_each(|x| *x = above(*x) + (exp(x.min(0.0)) - 1.0)),
        });
    }

    /// Multiplies gradients by the slope at values y.
    pub fn chain(self, y: &[f32], gradient: &mut [f32]) {
        let pairs = gradient.iter_mut().zip(y);
        Arch::new().dispatch(|| match self {
            Self::Tanh => pairs.for_each(|(g, y)| *g *= 1.0 - y * y),
            Self::Relu => pairs.for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 }),
            Self::Elu => pairs.for_each(|(g, y)| *g *= y.min(0.0) + 1.0),
        });
    }
}

/// `max(x, 0)`; `f32::max` takes 0 before what is no number.
#[inline(always)]
fn above(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// `(1 - e) / (1 + e)` with the sign of x, `e = exp(-2 |x|)`.
#[inline(always)]
fn tanh(x: f32) -> f32 {
    let e = exp(-2.0 * x.abs());
    ((1.0 - e) / (1.0 + e)).copysign(x)
}

/// `e^x` for x <= 0: `2^k e^r` with |r| <= ln 2 / 2 and Taylor's series to r^6.
#[inline(always)]
fn exp(x: f32) -> f32 {
    let x = if x < -87.0 { -87.0 } else { x };
    // Adding and taking away 1.5 x 2^23 rounds to a whole number, which then stands in the low bits.
    let shift = 12_582_912.0f32;
    let shifted = x * std::f32::consts::LOG2_E + shift;
    let r = x - (shifted - shift) * std::f32::consts::LN_2;
    let series = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r / 720.0)))));
    series * f32::from_bits(shifted.to_bits().wrapping_sub(shift.to_bits()).wrapping_add(127) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn activations_and_slopes_are_those_of_the_library() {
        let library = |which, x: f64| match which {
            Activation::Tanh => x.tanh(),
            Activation::Relu => x.max(0.0),
            Activation::Elu => {
                if x > 0.0 {
                    x
                } else {
                    x.exp_m1()
                }
            }
        };
        for which in [Activation::Tanh, Activation::Relu, Activation::Elu] {
            let xs: Vec<f32> = (-4000..4000).map(|k| k as f32 * 5e-3 + 1e-4).collect();
            let (mut ys, mut slopes) = (xs.clone(), vec![1.0; xs.len()]);
            which.apply(&mut ys);
            which.chain(&ys, &mut slopes);
            let mut none = [f32::NAN];
            which.apply(&mut none);
            assert!(none[0].is_nan(), "{which:?}(NaN) = {}", none[0]);
            for ((x, y), slope) in xs.iter().zip(&ys).zip(&slopes) {
                let x = f64::from(*x);
                let (value, h) = (library(which, x), 1e-6);
                let difference = (library(which, x + h) - library(which, x - h)) / (2.0 * h);
                assert!((f64::from(*y) - value).abs() < 5e-7, "{which:?}({x}) = {y}, should be {value}");
                assert!((f64::from(*slope) - difference).abs() < 1e-5, "{which:?}'({x}) = {slope}, should be {difference}");
            }
        }
    }
}
