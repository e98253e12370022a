//! Causal attention, forward and backward: over the tokens of each window, or of one new token to a stream's cached
//! tokens.
//!
//! For q, k, v `[tokens][d]` of a head: `S = q k^T / sqrt(d)`, weights `P = softmax(S)` over the visible tokens,
//! `o = P v`. Backward: `dv = P^T do`, `dP = do v^T`, `dS = P (dP - sum_j P dP)`, `dq = dS k / sqrt(d)`,
//! `dk = dS^T q / sqrt(d)`.
//!
//! Keys are stored transposed, one row per column of a head: the scores of all tokens are one sum of vectors.

use pulp::Arch;

use super::elementwise::softmax;

/// Shape of attention over windows, and working memory for one head.
#[derive(Default)]
pub struct Attention {
    tokens: usize,
    heads: usize,
    embedding: usize,
    /// Tokens that a token attends to, itself included.
    reach: usize,
    /// Cosines and sines of the rotary angles at each position, `[tokens][2][d / 2]`; empty without rotary positions.
    turns: Vec<f32>,
    /// Keys or values of a head, transposed, `[d][width]`.
    lying: Vec<f32>,
    row: Vec<f32>,
}

impl Attention {
    /// Sets the shape, see [`super::super::Op::Attend`].
    pub fn shape(&mut self, embedding: usize, heads: usize, tokens: usize, band: Option<usize>, frequencies: &[f64]) {
        (self.embedding, self.heads, self.tokens, self.reach) = (embedding, heads, tokens, band.unwrap_or(tokens));
        if self.turns.len() != 2 * tokens * frequencies.len() {
            let angles = |place: usize| frequencies.iter().map(move |f| (place as f64 * f).sin_cos());
            let turn = |place| angles(place).map(|(_, cos)| cos as f32).chain(angles(place).map(|(sin, _)| sin as f32));
            self.turns = (0..tokens).flat_map(turn).collect();
        }
    }

    /// Maps `qkv` `[windows tokens][3 E]` to `out` `[windows tokens][E]`. Leaves queries and keys rotated, and
    /// attention weights in `shares` `[window][head][tokens][width]`.
    pub fn forward(&mut self, qkv: &mut [f32], shares: &mut Vec<f32>, out: &mut Vec<f32>) {
        let t = self.tokens;
        let e = self.embedding;
        let width = width(self.tokens);
        let windows = qkv.len() / (t * 3 * e);
        shares.resize(windows * self.heads * t * width, 0.0);
        out.resize(windows * t * e, 0.0);
        Arch::new().dispatch(|| {
            for ((qkv, out), shares) in qkv
                .chunks_exact_mut(t * 3 * e)
                .zip(out.chunks_exact_mut(t * e))
                .zip(shares.chunks_exact_mut(self.heads * t * width))
            {
                self.turn(qkv, 1.0);
                for (head, shares) in shares.chunks_exact_mut(t * width).enumerate() {
                    self.lay(qkv, 1, head);
                    for (i, shares) in shares.chunks_exact_mut(width).enumerate() {
                        let seen = self.seen(i);
                        let d = e / self.heads;
                        let values = &qkv[self.at(2, head, seen.start).start..];
                        mix(
                            &qkv[self.at(0, head, i)],
                            &self.lying,
                            (values, 3 * e),
                            seen,
                            shares,
                            &mut out[i * e + head * d..][..d],
                        );
                    }
                }
            }
        });
    }

    /// Adjoint of [`Attention::forward`]: `dqkv` from `upstream` `[windows tokens][E]`. Needs `qkv` and `shares` of the
    /// forward pass.
    pub fn backward(&mut self, qkv: &[f32], shares: &[f32], upstream: &[f32], dqkv: &mut Vec<f32>) {
        let t = self.tokens;
        let e = self.embedding;
        let width = width(self.tokens);
        dqkv.clear();
        dqkv.resize(qkv.len(), 0.0);
        Arch::new().dispatch(|| {
            for (((qkv, dqkv), upstream), shares) in qkv
                .chunks_exact(t * 3 * e)
                .zip(dqkv.chunks_exact_mut(t * 3 * e))
                .zip(upstream.chunks_exact(t * e))
                .zip(shares.chunks_exact(self.heads * t * width))
            {
                for (head, shares) in shares.chunks_exact(t * width).enumerate() {
                    self.unmix(qkv, head, shares, upstream, dqkv);
                }
                self.turn(dqkv, -1.0);
            }
        });
    }

    /// Rotates queries and keys of a window to their positions; sign -1 rotates back.
    #[inline(always)]
    fn turn(&self, qkv: &mut [f32], sign: f32) {
        let e = self.embedding;
        let d = self.embedding / self.heads;
        for (row, turns) in qkv.chunks_exact_mut(3 * e).zip(self.turns.chunks_exact(d)) {
            turn(&mut row[..2 * e], turns, sign);
        }
    }

    /// Range of a head's query, key or value (part 0, 1, 2) of a token in `qkv`.
    #[inline(always)]
    fn at(&self, part: usize, head: usize, token: usize) -> std::ops::Range<usize> {
        let d = self.embedding / self.heads;
        let first = (3 * token + part) * self.embedding + head * d;
        first..first + d
    }

    /// Transposes keys or values (part 1 or 2) of a head into `lying`.
    #[inline(always)]
    fn lay(&mut self, qkv: &[f32], part: usize, head: usize) {
        let d = self.embedding / self.heads;
        let width = width(self.tokens);
        self.lying.clear();
        self.lying.resize(d * width, 0.0);
        for token in 0..self.tokens {
            for (m, x) in qkv[self.at(part, head, token)].iter().enumerate() {
                self.lying[m * width + token] = *x;
            }
        }
    }

    /// The tokens that a token attends to.
    #[inline(always)]
    fn seen(&self, token: usize) -> std::ops::Range<usize> {
        (token + 1).saturating_sub(self.reach)..token + 1
    }

    #[inline(always)]
    fn unmix(&mut self, qkv: &[f32], head: usize, shares: &[f32], upstream: &[f32], dqkv: &mut [f32]) {
        let d = self.embedding / self.heads;
        let width = width(self.tokens);
        let scale = (d as f32).sqrt().recip();
        self.lay(qkv, 2, head);
        let mut gradients = std::mem::take(&mut self.row);
        for (i, shares) in shares.chunks_exact(width).enumerate() {
            let seen = self.seen(i);
            let upstream = &upstream[i * self.embedding + head * d..][..d];
            gradients.resize(width, 0.0);
            sums(&mut gradients, upstream, &self.lying, width);
            let along: f32 = gradients.iter().zip(shares).map(|(s, p)| s * p).sum();
            gradients.iter_mut().zip(shares).for_each(|(s, p)| *s = p * (*s - along) * scale);
            let keys = &qkv[self.at(1, head, seen.start).start..];
            sums(&mut dqkv[self.at(0, head, i)], &gradients[seen.clone()], keys, 3 * self.embedding);
            for j in seen {
                add(&mut dqkv[self.at(2, head, j)], shares[j], upstream);
                add(&mut dqkv[self.at(1, head, j)], gradients[j], &qkv[self.at(0, head, i)]);
            }
        }
        self.row = gradients;
    }
}

/// Cached keys and values of a stream's last tokens in one layer.
pub struct Ring<'a> {
    /// Number of cached tokens.
    pub history: usize,
    /// Keys, rotated and transposed, `[E][width]`, then values `[history][E]`; [`Ring::floats`] in all.
    pub past: &'a mut [f32],
    /// Number of tokens of the stream before the new one.
    pub before: usize,
}

impl Ring<'_> {
    /// Size of the cache in floats; zero for a history of one token.
    pub fn floats(embedding: usize, history: usize) -> usize {
        if history == 1 { 0 } else { embedding * (width(history) + history) }
    }

    /// Attention output `[E]` for a new token `[q k v]`, which replaces the oldest in the cache. `turns` are cosines
    /// and sines of its position.
    #[inline(always)]
    pub fn push(&mut self, qkv: &mut [f32], heads: usize, turns: &[f32], shares: &mut Vec<f32>, out: &mut [f32]) {
        if self.history == 1 {
            // Attention over the new token alone returns that token's value.
            return out.copy_from_slice(&qkv[2 * out.len()..]);
        }
        let e = out.len();
        let d = out.len() / heads;
        let width = width(self.history);
        turn(&mut qkv[..2 * e], turns, 1.0);
        let slot = self.before % self.history;
        let seen = 0..(self.before + 1).min(self.history);
        let (keys, values) = self.past.split_at_mut(e * width);
        values[slot * e..][..e].copy_from_slice(&qkv[2 * e..]);
        for (keys, k) in keys.chunks_exact_mut(width).zip(&qkv[e..2 * e]) {
            keys[slot] = *k;
        }
        shares.resize(width, 0.0);
        for (head, ((q, keys), out)) in
            qkv[..e].chunks_exact(d).zip(keys.chunks_exact(d * width)).zip(out.chunks_exact_mut(d)).enumerate()
        {
            mix(q, keys, (&values[head * d..], e), seen.clone(), shares, out);
        }
    }
}

/// Row length of attention weights, padded to whole vectors.
fn width(tokens: usize) -> usize {
    tokens.next_multiple_of(8)
}

/// Rotates the column pairs (m, m + d/2) of every head by the cosines and sines of a position, `[2][d / 2]`; sign -1
/// rotates back.
#[inline(always)]
fn turn(heads: &mut [f32], turns: &[f32], sign: f32) {
    let d = turns.len();
    let (cos, sin) = turns.split_at(d / 2);
    for head in heads.chunks_exact_mut(d) {
        let (a, b) = head.split_at_mut(d / 2);
        for ((a, b), (cos, sin)) in a.iter_mut().zip(b).zip(cos.iter().zip(sin)) {
            (*a, *b) = (*a * cos - *b * sin * sign, *a * sin * sign + *b * cos);
        }
    }
}

/// Attention of one query of a head: writes the weights `[width]` over transposed keys `[d][width]`, and the weighted
/// sum of values to `out` `[d]`. `values` starts at the first visible token and has stride `apart`.
#[inline(always)]
fn mix(
    query: &[f32],
    keys: &[f32],
    (values, apart): (&[f32], usize),
    seen: std::ops::Range<usize>,
    shares: &mut [f32],
    out: &mut [f32],
) {
    let scale = (query.len() as f32).sqrt().recip();
    sums(shares, query, keys, shares.len());
    softmax(shares, seen.clone(), scale);
    sums(out, &shares[seen], values, apart);
}

/// `out_c = sum_k a_k rows_kc` for rows at a stride; sums stay in registers.
#[inline(always)]
fn sums(out: &mut [f32], a: &[f32], rows: &[f32], stride: usize) {
    let mut first = 0;
    let (wide, rest) = out.as_chunks_mut::<16>();
    for out in wide {
        *out = lanes(a, &rows[first..], stride);
        first += 16;
    }
    let (narrow, rest) = rest.as_chunks_mut::<8>();
    for out in narrow {
        *out = lanes(a, &rows[first..], stride);
        first += 8;
    }
    for (c, out) in rest.iter_mut().enumerate() {
        [*out] = lanes(a, &rows[first + c..], stride);
    }
}

/// [`sums`] over N columns, which fit in registers.
#[inline(always)]
fn lanes<const N: usize>(a: &[f32], rows: &[f32], stride: usize) -> [f32; N] {
    let mut sum = [0.0; N];
    for (k, a) in a.iter().enumerate() {
        let row = &rows[k * stride..][..N];
        // A loop, since a closure may compile without wide vectors.
        for (sum, x) in sum.iter_mut().zip(row) {
            *sum += a * x;
        }
    }
    sum
}

/// `y += a x`.
#[inline(always)]
fn add(y: &mut [f32], a: f32, x: &[f32]) {
    let (y, y_rest) = y.as_chunks_mut::<8>();
    let (x, x_rest) = x.as_chunks::<8>();
    for (y, x) in y.iter_mut().zip(x) {
        (0..8).for_each(|i| y[i] += a * x[i]);
    }
    y_rest.iter_mut().zip(x_rest).for_each(|(y, x)| *y += a * x);
}
