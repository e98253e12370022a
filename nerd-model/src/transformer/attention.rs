//! Causal self-attention.

use burn::module::{Module, Param};
use burn::tensor::{Tensor, activation::softmax};

use super::network::Reader;
use super::places::Places;

/// Causal multi-head self-attention.
///
/// Causal self-attention over the tokens of one window.
///
/// `[q k v] = x W_qkv`, split in heads of width d = E / heads; `A = softmax(q k^T / sqrt(d) + M) v` with the mask
/// M_ij = 0 where token i may look at token j and -inf elsewhere ([`Places`]); the result is `A W_proj`. No biases, no
/// dropout.
#[derive(Module, Debug)]
pub struct Attention {
    qkv: Param<Tensor<2>>,
    proj: Param<Tensor<2>>,
    heads: usize,
}

impl Attention {
    pub(super) fn new(reader: &mut Reader, heads: usize) -> Self {
        Self { qkv: reader.param(), proj: reader.param(), heads }
    }

    /// `[windows * tokens, E]` to the same shape; `places` are those of all `tokens`.
    ///
    /// The products with W run over flattened rows: burn's 3-D product makes one small product per window.
    pub fn forward(&self, x: Tensor<2>, tokens: usize, places: &Places) -> Tensor<2> {
        let [rows, e] = x.dims();
        let qkv = x.matmul(self.qkv.val());
        let part = |i: usize| self.split(qkv.clone().narrow(1, i * e, e), rows / tokens);
        self.mix(part(0), part(1), part(2), places).matmul(self.proj.val())
    }

    /// One query per window: `x` is `[windows * tokens, E]`, `newest` the row `[windows, E]` of `x` that asks,
    /// `places` its places; the result is `[windows, E]`.
    pub fn forward_last(&self, x: Tensor<2>, newest: Tensor<2>, places: &Places) -> Tensor<2> {
        let [windows, e] = newest.dims();
        let w = self.qkv.val();
        let q = newest.matmul(w.clone().narrow(1, 0, e));
        let kv = x.matmul(w.narrow(1, e, 2 * e));
        let part = |i: usize| self.split(kv.clone().narrow(1, i * e, e), windows);
        self.mix(self.split(q, windows), part(0), part(1), places).matmul(self.proj.val())
    }

    /// `[windows * tokens, E]` to `[windows, heads, tokens, d]`.
    fn split(&self, x: Tensor<2>, windows: usize) -> Tensor<4> {
        let [rows, e] = x.dims();
        x.reshape([windows, rows / windows, self.heads, e / self.heads]).swap_dims(1, 2)
    }

    /// `softmax(q k^T / sqrt(d) + mask) v`, heads joined again: `[windows * queries, E]`.
    fn mix(&self, q: Tensor<4>, k: Tensor<4>, v: Tensor<4>, places: &Places) -> Tensor<2> {
        let [windows, heads, queries, d] = q.dims();
        softmax(places.scores(q, k), 3).matmul(v).swap_dims(1, 2).reshape([windows * queries, heads * d])
    }
}
