//! Activations, forward and backward. Derivatives follow from the output y: `1 - y^2` for tanh; 1 where y > 0 for relu;
//! 1, below 0 `y + 1`, for elu. The forward pass stores the derivative of gelu. NaNs propagate.

use std::f32::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};

use pulp::Arch;

use super::elementwise::{at_least, erf, erf_and_bell, exp};
use crate::program::Activation;

/// `y = f(x)`. On return x is y's old buffer or, for gelu with `keep`, the derivative.
pub fn forward(f: Activation, keep: bool, x: &mut Vec<f32>, y: &mut Vec<f32>) {
    if f == Activation::Gelu && keep {
        return gelu_and_derivative(x, y);
    }
    std::mem::swap(x, y);
    let arch = Arch::new();
    let all = y.iter_mut();
    // One loop per activation: the compiler does not vectorise several loops in one closure.
    match f {
        Activation::Gelu => arch.dispatch(|| all.for_each(|x| *x *= 0.5 * (1.0 + erf(*x * FRAC_1_SQRT_2)))),
        Activation::Relu => arch.dispatch(|| all.for_each(|x| *x = at_least(*x, 0.0))),
        Activation::Tanh => arch.dispatch(|| all.for_each(|x| *x = tanh(*x))),
        Activation::Elu => arch.dispatch(|| all.for_each(|x| *x = at_least(*x, 0.0) + (exp(x.min(0.0)) - 1.0))),
    }
}

/// `y = gelu(a) b` for rows `x = [a b]` of `width` numbers; y has `width / 2`.
pub fn gate(x: &[f32], width: usize, y: &mut Vec<f32>) {
    y.resize(x.len() / 2, 0.0);
    Arch::new().dispatch(|| {
        for (x, y) in x.chunks_exact(width).zip(y.chunks_exact_mut(width / 2)) {
            let (a, b) = x.split_at(width / 2);
            for ((y, a), b) in y.iter_mut().zip(a).zip(b) {
                *y = 0.5 * a * (1.0 + erf(a * FRAC_1_SQRT_2)) * b;
            }
        }
    });
}

/// Gelu(x) divided by x, then the derivative of gelu at x.
#[inline(always)]
fn share_and_slope(x: f32) -> (f32, f32) {
    let (erf, bell) = erf_and_bell(x * FRAC_1_SQRT_2);
    let share = 0.5 * (1.0 + erf);
    (share, share + x * bell * (0.5 * FRAC_1_SQRT_2 * FRAC_2_SQRT_PI))
}

/// Adjoint of [`gate`]: `dx` from `dy`.
pub fn gate_back(x: &[f32], width: usize, dy: &[f32], dx: &mut Vec<f32>) {
    dx.resize(x.len(), 0.0);
    Arch::new().dispatch(|| {
        for ((x, dx), dy) in x.chunks_exact(width).zip(dx.chunks_exact_mut(width)).zip(dy.chunks_exact(width / 2)) {
            let (a, b) = x.split_at(width / 2);
            let (da, db) = dx.split_at_mut(width / 2);
            for ((((a, b), da), db), dy) in a.iter().zip(b).zip(da).zip(db).zip(dy) {
                let (share, slope) = share_and_slope(*a);
                (*da, *db) = (dy * b * slope, dy * a * share);
            }
        }
    });
}

/// `active = x (1 + erf(x / sqrt 2)) / 2`. Replaces x by the derivative, so that the backward pass only multiplies.
fn gelu_and_derivative(x: &mut [f32], active: &mut Vec<f32>) {
    active.resize(x.len(), 0.0);
    Arch::new().dispatch(|| {
        for (x, active) in x.iter_mut().zip(active.iter_mut()) {
            let (share, slope) = share_and_slope(*x);
            (*active, *x) = (*x * share, slope);
        }
    });
}

/// `(1 - e) / (1 + e)` with the sign of x, `e = exp(-2 |x|)`.
#[inline(always)]
fn tanh(x: f32) -> f32 {
    let e = exp(-2.0 * x.abs());
    ((1.0 - e) / (1.0 + e)).copysign(x)
}

/// Adjoint of [`forward`], in place on `gradient`; `kept` is x as [`forward`] left it.
pub fn backward(f: Activation, kept: &[f32], y: &[f32], gradient: &mut [f32]) {
    let arch = Arch::new();
    let pairs = gradient.iter_mut().zip(if f == Activation::Gelu { kept } else { y });
    match f {
        Activation::Gelu => arch.dispatch(|| pairs.for_each(|(g, derivative)| *g *= derivative)),
        Activation::Relu => arch.dispatch(|| pairs.for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 })),
        Activation::Tanh => arch.dispatch(|| pairs.for_each(|(g, y)| *g *= 1.0 - y * y)),
        Activation::Elu => arch.dispatch(|| pairs.for_each(|(g, y)| *g *= y.min(0.0) + 1.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Tests against burn (`tests/program.rs`) cover derivatives and GELU, which the standard library lacks.
    #[test]
    fn activations_are_those_of_the_library_and_nan_stays() {
        let xs: Vec<f32> = (-4000..4000).map(|k| k as f32 * 5e-3 + 1e-4).chain([f32::NAN]).collect();
        type Function = fn(f64) -> f64;
        let tanh: Function = f64::tanh;
        let elu: Function = |x| if x < 0.0 { x.exp_m1() } else { x };
        for (f, library) in [
            (Activation::Tanh, tanh),
            (Activation::Elu, elu),
            (Activation::Relu, |x| x.max(0.0)),
            (Activation::Gelu, |x| x),
        ] {
            let mut ys = Vec::new();
            forward(f, false, &mut xs.clone(), &mut ys);
            assert!(ys[xs.len() - 1].is_nan(), "{f:?}(NaN) = {}", ys[xs.len() - 1]);
            let off =
                xs.iter().zip(&ys).map(|(x, y)| (f64::from(*y) - library(f64::from(*x))).abs()).fold(0.0, f64::max);
            assert!(f == Activation::Gelu || off < 5e-7, "{f:?}: off by {off:.1e}");
        }
    }
}
