//! Concatenates each row with the rows of two neighbouring tokens in the window, forward and backward.

use super::elementwise::add;

/// Rows `[x_{k-d} x_k x_{k+d}]`, d = `apart`, for rows of `width`; zeros beyond the ends of windows of `tokens` tokens.
pub fn forward(x: &[f32], width: usize, tokens: usize, apart: usize, out: &mut Vec<f32>) {
    out.resize(3 * x.len(), 0.0);
    for (x, out) in x.chunks_exact(tokens * width).zip(out.chunks_exact_mut(3 * tokens * width)) {
        for (k, out) in out.chunks_exact_mut(3 * width).enumerate() {
            for (other, out) in places(k, tokens, apart).into_iter().zip(out.chunks_exact_mut(width)) {
                match other {
                    Some(other) => out.copy_from_slice(&x[other * width..][..width]),
                    None => out.fill(0.0),
                }
            }
        }
    }
}

/// Adjoint of [`forward`]: `dx` from `upstream`.
pub fn backward(upstream: &[f32], width: usize, tokens: usize, apart: usize, dx: &mut Vec<f32>) {
    dx.clear();
    dx.resize(upstream.len() / 3, 0.0);
    for (dx, upstream) in dx.chunks_exact_mut(tokens * width).zip(upstream.chunks_exact(3 * tokens * width)) {
        for (k, upstream) in upstream.chunks_exact(3 * width).enumerate() {
            for (other, upstream) in places(k, tokens, apart).into_iter().zip(upstream.chunks_exact(width)) {
                let Some(other) = other else { continue };
                add(&mut dx[other * width..][..width], upstream);
            }
        }
    }
}

/// Indices of the left neighbour of token k, of token k and of its right neighbour; `None` beyond a window's end.
fn places(k: usize, tokens: usize, apart: usize) -> [Option<usize>; 3] {
    [k.checked_sub(apart), Some(k), Some(k + apart).filter(|other| *other < tokens)]
}
