//! What stands between two products, over rows and in the widest vectors.

use nerd_model::transformer::elementwise::{erf_and_bell, sum};
use pulp::Arch;

use crate::learner::sharded::Loss;

/// Rows of x to mean 0 and variance 1 (epsilon 1e-5, biased variance), and what they were divided by, inverted.
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

/// Adds to `dx` the gradient in front of [`normalize`], `behind` being that behind it: `(g - mean g - y mean g y) / deviation`.
pub fn normalize_back(behind: &mut [f32], out: &[f32], inverse: &[f32], dx: &mut [f32]) {
    let e = out.len() / inverse.len();
    Arch::new().dispatch(|| {
        for (((g, y), inverse), dx) in behind.chunks_exact_mut(e).zip(out.chunks_exact(e)).zip(inverse).zip(dx.chunks_exact_mut(e)) {
            let mean = sum(g, |g| g) / e as f32;
            // The mean of y is 0, so that of g may be taken away first.
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

/// `active = x (1 + erf(x / sqrt 2)) / 2`, and x becomes the slope there, so that the backward pass only multiplies.
pub fn gelu(x: &mut [f32], active: &mut Vec<f32>) {
    use std::f32::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};
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

/// `x = max(x + bias, 0)` for every row; what is no number stays none.
pub fn relu(x: &mut [f32], bias: &[f32]) {
    let of = |x: f32| if x < 0.0 { 0.0 } else { x };
    x.chunks_exact_mut(bias.len()).for_each(|row| row.iter_mut().zip(bias).for_each(|(x, b)| *x = of(*x + b)));
}

/// The gradient in front of [`relu`].
pub fn relu_back(behind: &mut [f32], out: &[f32]) {
    behind.iter_mut().zip(out).for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 });
}

/// `a *= b`.
pub fn multiply(a: &mut [f32], b: &[f32]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a *= b);
}

/// `out += ` the sum of all rows.
pub fn sum_rows(rows: &[f32], out: &mut [f32]) {
    rows.chunks_exact(out.len()).for_each(|row| out.iter_mut().zip(row).for_each(|(o, x)| *o += x));
}

/// Sum of squares.
pub fn squares(error: &[f32]) -> f64 {
    error.iter().map(|e| f64::from(e * e)).sum()
}

/// Errors become the loss's slopes.
pub fn slope(error: &mut [f32], Loss { scale, huber }: Loss) {
    let scale = scale as f32;
    match huber {
        None => error.iter_mut().for_each(|e| *e *= 2.0 * scale),
        Some(d) => error.iter_mut().for_each(|e| *e *= 2.0 * scale / (1.0 + (*e / d) * (*e / d)).sqrt()),
    }
}
