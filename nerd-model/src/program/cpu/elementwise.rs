//! Element-wise f32 functions, inlined into the caller's `dispatch`. The compiler vectorises them at the width that
//! `pulp` detects at run time.

use std::ops::AddAssign;

use pulp::Arch;

/// The larger of two numbers, NaN if x is NaN (`f32::max` would return the other).
#[inline(always)]
pub fn at_least(x: f32, least: f32) -> f32 {
    if x < least { least } else { x }
}

/// `e^x` for x <= 0 by `2^k e^r`, |r| <= ln 2 / 2, Taylor series to r^7. The relative error is 2e-8; below x = -87 the
/// result is 0.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let x = at_least(x, -87.0);
    // Adding and subtracting 1.5 x 2^23 rounds to an integer.
    let shift = 12_582_912.0f32;
    let shifted = x * std::f32::consts::LOG2_E + shift;
    let k = shifted - shift;
    // ln 2 in two parts keeps the digits of r.
    let r = (x - k * 0.693_359_4) + k * 2.121_944_4e-4;
    let series = 1.0
        + r * (1.0
            + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r / 5040.0))))));
    // The low bits of `shifted` contain k, which saves a conversion that vector units do only with checks.
    series * f32::from_bits(shifted.to_bits().wrapping_sub(shift.to_bits()).wrapping_add(127) << 23)
}

/// erf by Abramowitz and Stegun 7.1.26, with an absolute error up to 1.5e-7.
#[inline(always)]
pub fn erf(x: f32) -> f32 {
    erf_and_bell(x).0
}

/// Argument above which `e^(-x^2)`, 1e-11 there, counts as 0. Values near 1e-38 would make gradients subnormal, which
/// is far slower.
const FADED: f32 = 5.0;

/// [`erf`] of x, and `e^(-x^2)`, which is a factor of erf and of its derivative.
#[inline(always)]
pub fn erf_and_bell(x: f32) -> (f32, f32) {
    let a = x.abs();
    let t = 1.0 / (1.0 + 0.327_591_1 * a);
    let series = t * (0.254_829_6 + t * (-0.284_496_74 + t * (1.421_413_7 + t * (-1.453_152 + t * 1.061_405_4))));
    let bell = if a > FADED { 0.0 } else { exp(-a * a) };
    ((1.0 - series * bell).copysign(x), bell)
}

/// Normalises rows of `e` numbers to mean 0 and variance 1 (epsilon 1e-5, biased variance). `inverse[row]` receives 1 /
/// standard deviation.
pub fn normalize(x: &[f32], e: usize, out: &mut Vec<f32>, inverse: &mut Vec<f32>) {
    out.resize(x.len(), 0.0);
    inverse.resize(x.len() / e, 0.0);
    Arch::new().dispatch(|| {
        for ((x, out), inverse) in x.chunks_exact(e).zip(out.chunks_exact_mut(e)).zip(inverse.iter_mut()) {
            let mean = sum(x, |x| x) / e as f32;
            let variance = sum(x, |x| (x - mean) * (x - mean)) / e as f32;
            *inverse = (variance + 1e-5).sqrt().recip();
            out.iter_mut().zip(x).for_each(|(o, x)| *o = (x - mean) * *inverse);
        }
    });
}

/// Sum of f over a row, in sixteen lanes, since a compiler may not reorder float sums.
#[inline(always)]
pub fn sum(row: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut lanes = [0.0f32; 16];
    let chunks = row.chunks_exact(16);
    let rest: f32 = chunks.remainder().iter().map(|x| f(*x)).sum();
    for chunk in chunks {
        lanes.iter_mut().zip(chunk).for_each(|(l, x)| *l += f(*x));
    }
    lanes.iter().sum::<f32>() + rest
}

/// Softmax of `scale` times the scores in `seen`; 0 elsewhere. Whole vectors are computed, scores outside `seen`
/// included, at no cost.
#[inline(always)]
pub fn softmax(scores: &mut [f32], seen: std::ops::Range<usize>, scale: f32) {
    for s in scores.iter_mut() {
        *s *= scale;
    }
    let most = scores[seen.clone()].iter().fold(f32::NEG_INFINITY, |a, b| a.max(*b));
    for s in scores.iter_mut() {
        *s = exp(*s - most);
    }
    let total: f32 = scores[seen.clone()].iter().sum();
    let inverse = 1.0 / total;
    for s in scores.iter_mut() {
        *s *= inverse;
    }
    scores[..seen.start].fill(0.0);
    scores[seen.end..].fill(0.0);
}

/// Adjoint of [`normalize`], added to `dx`: `(g - mean g - y mean(g y)) / deviation`. Overwrites `upstream`.
pub fn normalize_back(upstream: &mut [f32], out: &[f32], inverse: &[f32], dx: &mut [f32]) {
    let e = out.len() / inverse.len();
    Arch::new().dispatch(|| {
        for (((g, y), inverse), dx) in
            upstream.chunks_exact_mut(e).zip(out.chunks_exact(e)).zip(inverse).zip(dx.chunks_exact_mut(e))
        {
            let mean = sum(g, |g| g) / e as f32;
            // y has mean 0, so the mean of g may be subtracted first.
            g.iter_mut().for_each(|g| *g -= mean);
            let along = products(g, y) / e as f32;
            dx.iter_mut().zip(g).zip(y).for_each(|((dx, g), y)| *dx += (*g - y * along) * inverse);
        }
    });
}

/// `a . b`, in sixteen lanes.
#[inline(always)]
fn products(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; 16];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    for (a, b) in a.iter().zip(b) {
        lanes.iter_mut().zip(a.iter().zip(b)).for_each(|(l, (a, b))| *l += a * b);
    }
    lanes.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
}

/// Adds each number to the sum at the same index.
pub fn add<T: Copy + AddAssign>(sums: &mut [T], numbers: &[T]) {
    sums.iter_mut().zip(numbers).for_each(|(sum, x)| *sum += *x);
}

/// Adds the sum of all rows to `out`.
pub fn sum_rows(rows: &[f32], out: &mut [f32]) {
    rows.chunks_exact(out.len()).for_each(|row| add(out, row));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_and_error_function_are_those_of_the_textbook() {
        // Against the series of erf in f64, and the standard library's exp.
        let series = |x: f64| {
            let (mut term, mut total) = (x, x);
            for n in 1..100 {
                term *= -x * x / n as f64;
                total += term / (2 * n + 1) as f64;
            }
            total * std::f64::consts::FRAC_2_SQRT_PI
        };
        let (mut worst_exp, mut worst_erf) = (0.0f64, 0.0f64);
        for k in -4000..=4000 {
            let x = k as f32 * 1e-3;
            worst_erf = worst_erf.max((f64::from(erf(x)) - series(f64::from(x))).abs());
            let y = -(x + 4.0) * 10.0;
            worst_exp = worst_exp.max((f64::from(exp(y)) / f64::from(y).exp() - 1.0).abs());
        }
        let mut shares = [0.0, f32::NAN, 1.0];
        softmax(&mut shares, 0..3, 1.0);
        assert!(exp(f32::NAN).is_nan() && erf(f32::NAN).is_nan(), "what is not a number stays none");
        assert!(shares.iter().all(|s| s.is_nan()), "{shares:?}");
        assert!(worst_exp < 3e-7, "exp: {worst_exp:.1e} relative");
        assert!(worst_erf < 8e-7, "erf: {worst_erf:.1e}; the formula's is 1.5e-7, to which f32 adds its rounding");
    }
}
