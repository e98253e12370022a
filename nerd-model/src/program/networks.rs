//! The networks, each beside its equations.

use super::config::{Architecture, Positions, TransformerConfig};
use super::op::{Activation, Init, Op, Program, Slot, Step, TensorSpec};

impl TransformerConfig {
    /// What the network does.
    pub fn program(&self) -> Program {
        match self.architecture {
            Architecture::Transformer => transformer(self),
            Architecture::Residual => residual(self),
            Architecture::Mlp => mlp(self),
            Architecture::Gru | Architecture::Lstm => recurrent(self),
            Architecture::Chain => chain(self),
        }
    }

    /// Every tensor of the network in the order it is used. Linear weights are `[in, out]`, row-major: `y = x W + b`.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        self.program().tensors
    }

    /// Parameter count; of a Transformer
    /// `E (D_in + 1) + block E (of a table) + L (12 E^2 + 2 E) + E + E^2 + head (E + 1) + D_out (head + 1)`.
    pub fn parameters(&self) -> usize {
        self.tensors().iter().map(|t| t.len()).sum()
    }
}

/// The causal Transformer (paper A.2; nanoGPT blocks, pre-norm).
///
/// `x = W_in u + b_in + P[k]`, then per block `x += Attn(LN(x))`, `x += W_down gelu(W_up LN(x))`, a last `LN`, a linear `E -> E` without
/// bias, and the head `W_2 relu(W_1 x + b_1) + b_2`. Inside the blocks no biases; `LN` has a weight only. Attention is
/// `[q k v] = x W_qkv`, mixed by heads, times `W_proj`.
///
/// With [`Positions::Rotary`] there is no table P: queries and keys are turned by angles proportional to their place (Su et
/// al. 2021), so that only distances in time count, and a token sees the last h tokens alone. Then keys and values never
/// change once computed, and a rollout evaluates one token a frame.
fn transformer(c: &TransformerConfig) -> Program {
    let (e, small, scaled) = (c.embedding, Init::Normal(0.02), Init::Normal(0.02 / (2.0 * c.layers as f64).sqrt()));
    let mut p = Program::new(c.inputs);
    let x = p.linear("embed", p.tokens(), e, [small, Init::Constant(0.0)]);
    let band = match c.positions {
        Positions::Table => {
            let table = p.tensor("position.weight", &[c.block, e], small);
            p.steps.push(Step { from: x, to: x, op: Op::Place(table) });
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
        perceptron(&mut p, i, x, [small, scaled]);
    }
    let x = p.normed("norm", "out", x, e, small);
    head(p, x, c)
}

/// The Transformer of a single token: attention over one key is the value itself, so it is left out. Its perceptrons are gated, since
/// dynamics is full of products: `x += W_down (gelu(a) b)`, `[a b] = W_gated LN(x)`, a and b of three times the width. The head is
/// linear, `W_out LN(x) + b_out`.
fn residual(c: &TransformerConfig) -> Program {
    let (small, scaled) = (Init::Normal(0.02), Init::Normal(0.02 / (c.layers as f64).sqrt()));
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

/// `x += W_down gelu(W_up LN(x))` of a block.
fn perceptron(p: &mut Program, block: usize, x: Slot, [up, down]: [Init; 2]) {
    let (of, wide) = (|name: &str| format!("blocks.{block}.{name}"), 4 * p.width(x));
    let up = p.normed(&of("norm_mlp"), &of("mlp.up"), x, wide, up);
    let active = p.then(up, wide, Op::Activate(Activation::Gelu));
    p.residual(&of("mlp.down"), active, x, down);
}

/// A perceptron over single tokens, to be compared with the Transformer (paper A.3.3.1): a window is one token.
///
/// `x -> relu(W x + b)` in layers of 4 E, 2 E and E units (the official one has 512, 256, 128), then the head
/// `W_2 relu(W_1 x + b_1) + b_2`. Initial weights and biases uniform in +-1/sqrt(fan in).
fn mlp(c: &TransformerConfig) -> Program {
    let mut p = Program::new(c.inputs);
    let mut x = p.tokens();
    for (i, width) in [4 * c.embedding, 2 * c.embedding, c.embedding].into_iter().enumerate() {
        let init = Init::FanIn(p.width(x));
        let wide = p.linear(&format!("layers.{i}"), x, width, [init; 2]);
        x = p.then(wide, width, Op::Activate(Activation::Relu));
    }
    head(p, x, c)
}

/// Recurrent networks over the tokens of a window, to be compared with the Transformer (paper A.3.3.1).
///
/// Cells of width E one above the other, then the head `W_2 relu(W_1 x + b_1) + b_2`. With `u = W x + b` of the token and
/// `v = U h + c` of the state, both split by gate, a GRU's cell is (Cho and others 2014, as in PyTorch)
///
/// ```text
/// r = s(u_r + v_r)   z = s(u_z + v_z)   n = tanh(u_n + r v_n)   h' = n + z (h - n)
/// ```
///
/// and an LSTM's (Hochreiter and Schmidhuber 1997, with forget gate)
///
/// ```text
/// i, f, o = s(u + v)   g = tanh(u_g + v_g)   c' = f c + i g   h' = o tanh(c')
/// ```
///
/// The state is zero before the oldest token of a window, in training and in rollouts alike. Initial weights and biases
/// uniform in +-1/sqrt(E), as PyTorch's.
fn recurrent(c: &TransformerConfig) -> Program {
    let (e, lstm, init) = (c.embedding, c.architecture == Architecture::Lstm, Init::FanIn(c.embedding));
    let gates = if lstm { 4 } else { 3 };
    let mut p = Program::new(c.inputs);
    let mut x = p.tokens();
    for i in 0..c.layers {
        let u = p.linear(&format!("cells.{i}.token"), x, gates * e, [init; 2]);
        let weight = p.tensor(&format!("cells.{i}.state.weight"), &[e, gates * e], init);
        let bias = p.tensor(&format!("cells.{i}.state.bias"), &[gates * e], init);
        x = p.then(u, e, Op::Cell { weight, bias, lstm });
    }
    head(p, x, c)
}

/// Actor and critic: one trunk over a single observation, with heads for mean action, value and, by state, the
/// logarithm of the action's spread.
///
/// `x -> f(W x + b)` between these `widths`, the first that of an observation, f nothing in front of the last. A spread that is the same
/// in all states is the last tensor, `log_std`, of so many numbers, which no step reads. Initial weights uniform in +-1/sqrt(fan in),
/// biases and spread 0.
pub fn policy(widths: &[usize], f: Activation, spread: Option<usize>) -> Program {
    let (inputs, layers) = (widths.first().copied().unwrap_or(0), widths.len().saturating_sub(1));
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

/// How far apart the rods are that look at each other, block by block: with eight blocks each of forty sees all others.
const APART: [usize; 8] = [1, 2, 4, 8, 16, 4, 2, 1];

/// A network along a chain, whose tokens are its rods in one frame ([`crate::chain`]).
///
/// `h = W_in u + b_in + P[k]`, then per block `h += W_mix gelu(W_near [n_{k-d} n_k n_{k+d}] + b)` with `n = norm(h)` and d = 1, 2, 4, 8,
/// 16, 4, 2, 1, and so on from the start; at last `W_out norm(h) + b_out`. Outputs begin small, so that a chain that has learned
/// nothing goes straight on. No norm has a weight: the next matrix would absorb it.
fn chain(c: &TransformerConfig) -> Program {
    let (e, none) = (c.embedding, Init::Constant(0.0));
    let spread = |fan: usize, share: f64| Init::Normal(share / (fan as f64).sqrt());
    let mut p = Program::new(c.inputs);
    let h = p.linear("embed", p.tokens(), e, [spread(c.inputs, 1.0), none]);
    let table = p.tensor("position.weight", &[c.block, e], Init::Normal(0.02));
    p.steps.push(Step { from: h, to: h, op: Op::Place(table) });
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

/// `W_2 relu(W_1 x + b_1) + b_2`.
fn head(mut p: Program, x: Slot, c: &TransformerConfig) -> Program {
    let hidden = p.linear("head.hidden", x, c.head, [Init::FanIn(c.embedding); 2]);
    let hidden = p.then(hidden, c.head, Op::Activate(Activation::Relu));
    p.linear("head.out", hidden, c.outputs, [Init::FanIn(c.head); 2]);
    p
}
