//! One pre-norm block: `x += Attn(LN(x))`, then `x += W_down gelu(W_up LN(x))` with the exact (erf) GELU.

use burn::module::{Module, Param};
use burn::tensor::{Int, Tensor, activation::gelu};

use super::attention::Attention;
use super::network::Reader;
use super::places::Places;

/// Attention and MLP with their residuals.
#[derive(Module, Debug)]
pub struct Block {
    norm_attn: Param<Tensor<1>>,
    attn: Attention,
    norm_mlp: Param<Tensor<1>>,
    up: Param<Tensor<2>>,
    down: Param<Tensor<2>>,
}

impl Block {
    pub(super) fn new(reader: &mut Reader, heads: usize) -> Self {
        Self {
            norm_attn: reader.param(),
            attn: Attention::new(reader, heads),
            norm_mlp: reader.param(),
            up: reader.param(),
            down: reader.param(),
        }
    }

    /// `[windows * tokens, E]` to the same shape.
    pub fn forward(&self, x: Tensor<2>, tokens: usize, places: &Places) -> Tensor<2> {
        let x = x.clone() + self.attn.forward(norm(x, &self.norm_attn), tokens, places);
        self.mlp(x)
    }

    /// The rows `newest` (`[windows]`) of the result alone: `[windows, E]`. Only keys and values of the older tokens
    /// are computed, which saves most of the last block.
    pub fn forward_last(&self, x: Tensor<2>, newest: Tensor<1, Int>, places: &Places) -> Tensor<2> {
        let normed = norm(x.clone(), &self.norm_attn);
        let query = normed.clone().select(0, newest.clone());
        let x = x.select(0, newest) + self.attn.forward_last(normed, query, places);
        self.mlp(x)
    }

    fn mlp(&self, x: Tensor<2>) -> Tensor<2> {
        x.clone() + gelu(norm(x, &self.norm_mlp).matmul(self.up.val())).matmul(self.down.val())
    }
}

/// Layer norm over the last axis with a weight only, epsilon 1e-5: `w (x - mean) / sqrt(var + eps)`, biased variance.
pub(super) fn norm(x: Tensor<2>, weight: &Param<Tensor<1>>) -> Tensor<2> {
    burn::tensor::module::layer_norm(x, weight.val(), None, 1e-5)
}
