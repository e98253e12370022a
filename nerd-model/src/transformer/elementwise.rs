//! Element-wise work in f32, written so that the compiler makes vectors of it at the width `pulp` finds at run time: what is
//! inlined here, inside a `dispatch` of its caller's.

use pulp::Arch;

/// The larger of two, and what is no number if x is not: `f32::max` would take the other one.
#[inline(always)]
fn at_least(x: f32, least: f32) -> f32 {
    if x < least { least } else { x }
}

/// `e^x` for x <= 0 by `2^k e^r`, |r| <= ln 2 / 2, Taylor's series to r^7: 2e-8 relative, 0 below -87.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let x = at_least(x, -87.0);
    // Adding and taking away 1.5 x 2^23 rounds to a whole number.
    let shift = 12_582_912.0f32;
    let shifted = x * std::f32::consts::LOG2_E + shift;
    let k = shifted - shift;
    // ln 2 in two parts, so that r keeps its digits.
    let r = (x - k * 0.693_359_4) + k * 2.121_944_4e-4;
    let series = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r / 5040.0))))));
    // That number stands in the low bits of the shifted one: no conversion, which no vector unit does without checks.
    series * f32::from_bits(shifted.to_bits().wrapping_sub(shift.to_bits()).wrapping_add(127) << 23)
}

/// erf by Abramowitz and Stegun 7.1.26: 1.5e-7 absolute.
#[inline(always)]
pub fn erf(x: f32) -> f32 {
    erf_and_bell(x).0
}

/// [`erf`] and `e^(-x^2)`, which it is made of and its slope is proportional to.
#[inline(always)]
pub fn erf_and_bell(x: f32) -> (f32, f32) {
    let a = x.abs();
    let t = 1.0 / (1.0 + 0.327_591_1 * a);
    let series = t * (0.254_829_6 + t * (-0.284_496_74 + t * (1.421_413_7 + t * (-1.453_152 + t * 1.061_405_4))));
    let bell = exp(-a * a);
    ((1.0 - series * bell).copysign(x), bell)
}

/// `x (1 + erf(x / sqrt 2)) / 2`.
pub(super) fn gelu(x: &mut [f32]) {
    Arch::new().dispatch(|| x.iter_mut().for_each(|x| *x *= 0.5 * (1.0 + erf(*x * std::f32::consts::FRAC_1_SQRT_2))));
}

/// `max(x, 0)`.
pub(super) fn relu(x: &mut [f32]) {
    x.iter_mut().for_each(|x| *x = at_least(*x, 0.0));
}

/// Rows of `e` to mean 0 and variance 1 (epsilon 1e-5, biased variance).
pub(super) fn normalize(rows: &mut [f32], e: usize) {
    Arch::new().dispatch(|| {
        for row in rows.chunks_exact_mut(e) {
            let mean = sum(row, |x| x) / e as f32;
            let variance = sum(row, |x| (x - mean) * (x - mean)) / e as f32;
            let scale = (variance + 1e-5).sqrt().recip();
            row.iter_mut().for_each(|x| *x = (*x - mean) * scale);
        }
    });
}

/// Sum of f over a row, in sixteen lanes, since a compiler may not reorder a sum of floats.
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

/// `a . b`, in eight lanes.
#[inline(always)]
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; 8];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    for (a, b) in a.iter().zip(b) {
        for i in 0..8 {
            lanes[i] += a[i] * b[i];
        }
    }
    let halves = [lanes[0] + lanes[4], lanes[1] + lanes[5], lanes[2] + lanes[6], lanes[3] + lanes[7]];
    (halves[0] + halves[2]) + (halves[1] + halves[3]) + rest
}

/// Scores to shares that add up to 1.
#[inline(always)]
pub fn softmax(scores: &mut [f32]) {
    let most = scores.iter().fold(f32::NEG_INFINITY, |a, b| a.max(*b));
    let mut total = 0.0;
    for s in scores.iter_mut() {
        *s = exp(*s - most);
        total += *s;
    }
    let inverse = 1.0 / total;
    scores.iter_mut().for_each(|s| *s *= inverse);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_and_error_function_are_those_of_the_textbook() {
        // Against the series of erf in f64, and the library's exp.
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
        let mut rectified = [f32::NAN, -1.0, 2.0];
        relu(&mut rectified);
        let mut shares = [0.0, f32::NAN, 1.0];
        softmax(&mut shares);
        assert!(exp(f32::NAN).is_nan() && erf(f32::NAN).is_nan(), "what is no number stays none");
        assert!(rectified[0].is_nan() && rectified[1..] == [0.0, 2.0] && shares.iter().all(|s| s.is_nan()), "{rectified:?}, {shares:?}");
        assert!(worst_exp < 3e-7, "exp: {worst_exp:.1e} relative");
        assert!(worst_erf < 8e-7, "erf: {worst_erf:.1e}; the formula's is 1.5e-7, to which f32 adds its rounding");
    }
}
