//! The networks as programs, each with its equations.

use super::config::{Architecture, Positions, TransformerConfig};
use super::op::{Activation, Init, Op, Program, TensorSpec};

impl TransformerConfig {
    /// The network's program.
    pub fn program(&self) -> Program {
        match self.architecture {
            Architecture::Transformer => transformer(self),
            Architecture::Residual => residual(self),
            Architecture::Chain => chain(self),
        }
    }

    /// Every tensor of the network in order of use. Linear weights are `[in, out]`, row-major: `y = x W + b`.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        self.program().tensors
    }

    /// Number of parameters; for a Transformer `E (D_in + 1) + block E (of a table) + L (12 E^2 + 2 E) + E + E^2 + head
    /// (E + 1) + D_out (head + 1)`.
    pub fn parameters(&self) -> usize {
        self.tensors().iter().map(|t| t.len()).sum()
    }
}

/// The causal Transformer (paper A.2; nanoGPT blocks, pre-norm).
///
/// `x = W_in u + b_in + P[k]`, then per block `x += Attn(LN(x))`, `x += W_down gelu(W_up LN(x))`. Then `LN`, a linear
/// `E -> E` without bias, and the head `W_2 relu(W_1 x + b_1) + b_2`. Blocks have no biases; `LN` has a weight only.
/// Attention computes `[q k v] = x W_qkv`, attends by heads and multiplies by `W_proj`.
///
/// With [`Positions::Rotary`] there is no table P: queries and keys are rotated by angles proportional to their
/// position (Su et al. 2021), so only distances in time count. A token attends to the last h tokens alone. Keys and
/// values never change once computed, and a rollout evaluates one token per frame.
fn transformer(c: &TransformerConfig) -> Program {
    let e = c.embedding;
    let small = Init::Normal(0.02);
    let scaled = Init::Normal(0.02 / (2.0 * c.layers as f64).sqrt());
    let mut p = Program::new(c.inputs);
    let x = p.linear("embed", p.tokens(), e, [small, Init::Constant(0.0)]);
    let band = match c.positions {
        Positions::Table => {
            p.place("position", x, c.block, small);
            None
        }
        Positions::Rotary => {
            p.frequencies = c.frequencies().collect();
            Some(c.history)
        }
    };
    for i in 0..c.layers {
        let of = |name: &str| format!("blocks.{i}.{name}");
        let qkv = p.normed(&of("norm_attn"), &of("attn.qkv"), x, 3 * e, small);
        let mixed = p.then(qkv, e, Op::Attend { heads: c.heads, band });
        p.residual(&of("attn.proj"), mixed, x, scaled);
        let up = p.normed(&of("norm_mlp"), &of("mlp.up"), x, 4 * e, small);
        let active = p.then(up, 4 * e, Op::Activate(Activation::Gelu));
        p.residual(&of("mlp.down"), active, x, scaled);
    }
    let x = p.normed("norm", "out", x, e, small);
    let hidden = p.linear("head.hidden", x, c.head, [Init::FanIn(e); 2]);
    let hidden = p.then(hidden, c.head, Op::Activate(Activation::Relu));
    p.linear("head.out", hidden, c.outputs, [Init::FanIn(c.head); 2]);
    p
}

/// The Transformer of a single token. Attention over one key returns that key's value, so attention is omitted. Its
/// MLPs are gated, since dynamics are full of products: `x += W_down (gelu(a) b)`, `[a b] = W_gated LN(x)`, with a and
/// b three times as wide as x. The head is linear, `W_out LN(x) + b_out`.
fn residual(c: &TransformerConfig) -> Program {
    let small = Init::Normal(0.02);
    let scaled = Init::Normal(0.02 / (c.layers as f64).sqrt());
    let mut p = Program::new(c.inputs);
    let x = p.linear("embed", p.tokens(), c.embedding, [small, Init::Constant(0.0)]);
    for i in 0..c.layers {
        let of = |name: &str| format!("blocks.{i}.{name}");
        let gated = p.normed(&of("norm_mlp"), &of("mlp.gated"), x, 6 * c.embedding, small);
        let active = p.then(gated, 3 * c.embedding, Op::Gate);
        p.residual(&of("mlp.down"), active, x, scaled);
    }
    let scale = Some(p.tensor("norm.weight", &[c.embedding], Init::Constant(1.0)));
    let weight = p.tensor("head.weight", &[c.embedding, c.outputs], small);
    let bias = p.tensor("head.bias", &[c.outputs], Init::Constant(0.0));
    let x = p.then(x, c.embedding, Op::Norm);
    p.then(x, c.outputs, Op::Linear { weight, scale, bias: Some(bias), add: false });
    p
}

/// Actor and critic in one MLP over an observation. The outputs are mean action, value and, if state-dependent, the log
/// standard deviation of the action.
///
/// `x -> f(W x + b)` between these `widths`, the first an observation's, without f before the last. A state-independent
/// standard deviation is the last tensor, `log_std`, of `spread` numbers, which no step reads. Initial weights are
/// uniform in +-1/sqrt(fan in), biases and `log_std` 0.
pub fn policy(widths: &[usize], f: Activation, spread: Option<usize>) -> Program {
    let inputs = widths.first().copied().unwrap_or(0);
    let layers = widths.len().saturating_sub(1);
    let mut p = Program::new(inputs);
    let mut x = p.tokens();
    for (k, width) in widths.iter().skip(1).enumerate() {
        let init = [Init::FanIn(p.width(x)), Init::Constant(0.0)];
        x = p.linear(&format!("layer{k}"), x, *width, init);
        if k + 1 < layers {
            x = p.then(x, *width, Op::Activate(f));
        }
    }
    if let Some(actions) = spread {
        p.tensor("log_std", &[actions], Init::Constant(0.0));
    }
    p
}

/// Distance (rods) of the neighbours that each block mixes. After eight blocks, each of forty rods depends on all
/// others.
const APART: [usize; 8] = [1, 2, 4, 8, 16, 4, 2, 1];

/// A network along a chain, with the rods of one frame as tokens ([`crate::chain`]).
///
/// `h = W_in u + b_in + P[k]`, then per block `h += W_mix gelu(W_near [n_{k-d} n_k n_{k+d}] + b)` with `n = norm(h)`
/// and d = 1, 2, 4, 8, 16, 4, 2, 1, repeated; at last `W_out norm(h) + b_out`. Initial outputs are small, so that an
/// untrained chain keeps its velocity. No norm has a weight: the next matrix would absorb it.
fn chain(c: &TransformerConfig) -> Program {
    let e = c.embedding;
    let none = Init::Constant(0.0);
    let spread = |fan: usize, share: f64| Init::Normal(share / (fan as f64).sqrt());
    let mut p = Program::new(c.inputs);
    let h = p.linear("embed", p.tokens(), e, [spread(c.inputs, 1.0), none]);
    p.place("position", h, c.block, Init::Normal(0.02));
    for (i, apart) in (0..c.layers).zip(APART.into_iter().cycle()) {
        let n = p.then(h, e, Op::Norm);
        let near = p.then(n, 3 * e, Op::Neighbours(apart));
        let wide = p.linear(&format!("blocks.{i}.near"), near, e, [spread(3 * e, 1.0), none]);
        let active = p.then(wide, e, Op::Activate(Activation::Gelu));
        p.residual(&format!("blocks.{i}.mix"), active, h, spread(e, 0.3));
    }
    let n = p.then(h, e, Op::Norm);
    p.linear("out", n, c.outputs, [spread(e, 0.1), none]);
    p
}
