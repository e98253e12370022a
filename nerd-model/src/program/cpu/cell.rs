//! Recurrent cells over the tokens of each window, forward and backward (`program/networks.rs`).
//!
//! All windows take a step together. The forward pass stores each token's gates and, of an LSTM, c; of a GRU, `v_n`.

use super::Matrix;

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// States `[windows tokens][E]` from the tokens' inputs to the gates, `[windows tokens][gates E]`.
pub fn forward(u: &[f32], tokens: usize, weight: &Matrix, bias: &[f32], lstm: bool, kept: &mut Vec<f32>, out: &mut Vec<f32>) {
    let (gates, wide) = (if lstm { 4 } else { 3 }, bias.len());
    let width = wide / gates;
    let (windows, keep) = (u.len() / wide / tokens, (gates + 1) * width);
    kept.clear();
    kept.resize(windows * tokens * keep, 0.0);
    out.clear();
    out.resize(windows * tokens * width, 0.0);
    let (mut h, mut c, mut v) = (vec![0.0; windows * width], vec![0.0; windows * width], Vec::new());
    for k in 0..tokens {
        v.clear();
        (0..windows).for_each(|_| v.extend_from_slice(bias));
        weight.add_product(&h, &mut v);
        for window in 0..windows {
            let row = window * tokens + k;
            let (u, v, kept) = (&u[row * wide..][..wide], &v[window * wide..][..wide], &mut kept[row * keep..][..keep]);
            for m in 0..width {
                let (gate, at) = (|i: usize| u[i * width + m] + v[i * width + m], window * width + m);
                if lstm {
                    let [i, f, g, o] = [sigmoid(gate(0)), sigmoid(gate(1)), gate(2).tanh(), sigmoid(gate(3))];
                    c[at] = f * c[at] + i * g;
                    h[at] = o * c[at].tanh();
                    [i, f, g, o, c[at]].iter().enumerate().for_each(|(i, x)| kept[i * width + m] = *x);
                } else {
                    let (r, z, v_n) = (sigmoid(gate(0)), sigmoid(gate(1)), v[2 * width + m]);
                    let n = (u[2 * width + m] + r * v_n).tanh();
                    h[at] = n + z * (h[at] - n);
                    [r, z, n, v_n].iter().enumerate().for_each(|(i, x)| kept[i * width + m] = *x);
                }
            }
            out[row * width..][..width].copy_from_slice(&h[window * width..][..width]);
        }
    }
}

/// The backward pass of a cell over windows of so many tokens.
pub struct Backward<'a> {
    pub tokens: usize,
    pub lstm: bool,
    /// `W^T`.
    pub weight: &'a Matrix,
    /// What [`forward`] kept, and its states.
    pub kept: &'a [f32],
    pub out: &'a [f32],
}

impl Backward<'_> {
    /// Gradients from the upstream one: of u into `du`, of W and b onto theirs. `cut` is working memory.
    pub fn run(&self, upstream: &[f32], cut: &mut Matrix, d_weight: &mut [f32], d_bias: &mut [f32], du: &mut Vec<f32>) {
        let Self { tokens, lstm, weight, kept, out } = *self;
        let gates = if lstm { 4 } else { 3 };
        let (width, wide) = (d_bias.len() / gates, d_bias.len());
        let (windows, keep) = (out.len() / width / tokens, (gates + 1) * width);
        du.clear();
        du.resize(windows * tokens * wide, 0.0);
        let (mut dh, mut dc) = (vec![0.0; windows * width], vec![0.0; windows * width]);
        let (mut before, mut dv) = (vec![0.0; windows * width], vec![0.0; windows * wide]);
        for k in (0..tokens).rev() {
            for window in 0..windows {
                let row = window * tokens + k;
                let (du, dv) = (&mut du[row * wide..][..wide], &mut dv[window * wide..][..wide]);
                for m in 0..width {
                    let (at, d) = (window * width + m, dh[window * width + m] + upstream[row * width + m]);
                    let now = |i: usize| kept[row * keep + i * width + m];
                    // The state before the oldest token is zero.
                    let (h_before, c_before) = match k {
                        0 => (0.0, 0.0),
                        _ => (out[(row - 1) * width + m], kept[(row - 1) * keep + gates * width + m]),
                    };
                    before[at] = h_before;
                    if lstm {
                        let [i, f, g, o, c] = [0, 1, 2, 3, 4].map(now);
                        let bent = c.tanh();
                        let d_c = dc[at] + d * o * (1.0 - bent * bent);
                        let slopes =
                            [d_c * g * i * (1.0 - i), d_c * c_before * f * (1.0 - f), d_c * i * (1.0 - g * g), d * bent * o * (1.0 - o)];
                        slopes.iter().enumerate().for_each(|(i, x)| (du[i * width + m], dv[i * width + m]) = (*x, *x));
                        (dc[at], dh[at]) = (d_c * f, 0.0);
                    } else {
                        let [r, z, n, v_n] = [0, 1, 2, 3].map(now);
                        let d_n = d * (1.0 - z) * (1.0 - n * n);
                        let slopes = [d_n * v_n * r * (1.0 - r), d * (h_before - n) * z * (1.0 - z), d_n];
                        slopes.iter().enumerate().for_each(|(i, x)| (du[i * width + m], dv[i * width + m]) = (*x, *x));
                        dv[2 * width + m] = d_n * r;
                        dh[at] = d * z;
                    }
                }
            }
            cut.cut(windows, &dv);
            cut.across(&before, true, d_weight);
            super::elementwise::sum_rows(&dv, d_bias);
            weight.add_product(&dv, &mut dh);
        }
    }
}
