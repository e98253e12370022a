//! Activations, forward and backward. Derivatives follow from the output y: `1 - y^2` for tanh; 1 where y > 0 for relu; 1, below 0
//! `y + 1`, for elu. That of gelu is stored. NaNs propagate.

use std::f32::consts::FRAC_1_SQRT_2;

use pulp::Arch;

use super::elementwise::{at_least, erf, erf_and_bell, exp};
use crate::program::Activation;

/// `y = f(x)`. The memory of x is that of y afterwards, or, of a gelu whose way back is asked for, holds its gradient.
pub fn forward(f: Activation, keep: bool, x: &mut Vec<f32>, y: &mut Vec<f32>) {
    if f == Activation::Gelu && keep {
        return gelu_and_slope(x, y);
    }
    std::mem::swap(x, y);
    let (arch, all) = (Arch::new(), y.iter_mut());
    // Each its own: several loops in one closure are not made vectors of.
    match f {
        Activation::Gelu => arch.dispatch(|| all.for_each(|x| *x *= 0.5 * (1.0 + erf(*x * FRAC_1_SQRT_2)))),
        Activation::Relu => arch.dispatch(|| all.for_each(|x| *x = at_least(*x, 0.0))),
        Activation::Tanh => arch.dispatch(|| all.for_each(|x| *x = tanh(*x))),
        Activation::Elu => arch.dispatch(|| all.for_each(|x| *x = at_least(*x, 0.0) + (exp(x.min(0.0)) - 1.0))),
    }
}

/// `active = x (1 + erf(x / sqrt 2)) / 2`, and x becomes the gradient there, so that the backward pass only multiplies.
fn gelu_and_slope(x: &mut [f32], active: &mut Vec<f32>) {
    use std::f32::consts::FRAC_2_SQRT_PI;
    active.resize(x.len(), 0.0);
    Arch::new().dispatch(|| {
        for (x, active) in x.iter_mut().zip(active.iter_mut()) {
            let (erf, bell) = erf_and_bell(*x * FRAC_1_SQRT_2);
            let share = 0.5 * (1.0 + erf);
            *active = *x * share;
            *x = share + *x * bell * (0.5 * FRAC_1_SQRT_2 * FRAC_2_SQRT_PI);
        }
    });
}

/// `(1 - e) / (1 + e)` with the sign of x, `e = exp(-2 |x|)`.
#[inline(always)]
fn tanh(x: f32) -> f32 {
    let e = exp(-2.0 * x.abs());
    ((1.0 - e) / (1.0 + e)).copysign(x)
}

/// The gradient by the input of [`forward`] from the upstream one, in its place; `kept` is what x became.
pub fn backward(f: Activation, kept: &[f32], y: &[f32], gradient: &mut [f32]) {
    let (arch, pairs) = (Arch::new(), gradient.iter_mut().zip(if f == Activation::Gelu { kept } else { y }));
    match f {
        Activation::Gelu => arch.dispatch(|| pairs.for_each(|(g, slope)| *g *= slope)),
        Activation::Relu => arch.dispatch(|| pairs.for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 })),
        Activation::Tanh => arch.dispatch(|| pairs.for_each(|(g, y)| *g *= 1.0 - y * y)),
        Activation::Elu => arch.dispatch(|| pairs.for_each(|(g, y)| *g *= y.min(0.0) + 1.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn activations_and_slopes_are_those_of_the_library() {
        let library = |f, x: f64| match f {
            Activation::Tanh => x.tanh(),
            Activation::Elu if x < 0.0 => x.exp_m1(),
            _ => x.max(0.0),
        };
        // That of GELU has no function in the library; burn has (`tests/program.rs`).
        for f in [Activation::Relu, Activation::Tanh, Activation::Elu] {
            let xs: Vec<f32> = (-4000..4000).map(|k| k as f32 * 5e-3 + 1e-4).collect();
            let (mut kept, mut ys, mut slopes) = (xs.clone(), Vec::new(), vec![1.0; xs.len()]);
            forward(f, true, &mut kept, &mut ys);
            backward(f, &kept, &ys, &mut slopes);
            let (mut none, mut out) = (vec![f32::NAN], Vec::new());
            forward(f, true, &mut none, &mut out);
            assert!(out[0].is_nan(), "{f:?}(NaN) = {}", out[0]);
            for ((x, y), slope) in xs.iter().zip(&ys).zip(&slopes) {
                let (x, h) = (f64::from(*x), 1e-6);
                let (value, difference) = (library(f, x), (library(f, x + h) - library(f, x - h)) / (2.0 * h));
                assert!((f64::from(*y) - value).abs() < 5e-7, "{f:?}({x}) = {y}, should be {value}");
                assert!((f64::from(*slope) - difference).abs() < 1e-5, "{f:?}'({x}) = {slope}, should be {difference}");
            }
        }
    }
}
