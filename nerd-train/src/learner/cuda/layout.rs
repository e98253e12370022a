//! Where each tensor stands in the flat parameter vector, and the constants the kernels are compiled with.
//!
//! A LayerNorm weight is folded into the matrix behind it, `W' = diag(w) W`, once an update. The kernels then move
//! the plain normalised activations, and both gradients follow from the one of `W'`: `dW = diag(w) dW'` and
//! `dw_i = sum_j dW'_ij W_ij`.

use nerd_model::transformer::{Architecture, Positions, TransformerConfig};

use crate::learner::LearnError;

/// Largest dynamic shared memory every device gives without asking, bytes.
const SHARED: usize = 48 << 10;

/// Offsets of one block's tensors: in the flat vector for plain ones, in the folded vector for `qkv` and `up`.
pub(super) struct Block {
    pub qkv: Folded,
    pub proj: usize,
    pub up: Folded,
    pub down: usize,
}

/// A matrix with the LayerNorm weight before it folded in.
#[derive(Clone, Copy)]
pub(super) struct Folded {
    /// Offset in the flat vector (and of its gradient).
    pub plain: usize,
    /// Offset in the folded vector.
    pub folded: usize,
}

/// Offsets, counts and block sizes of one network shape.
pub(super) struct Layout {
    pub config: TransformerConfig,
    /// Tokens evaluated together: a training sequence, or one.
    pub tokens: usize,
    pub parameters: usize,
    pub embed: usize,
    pub embed_bias: usize,
    /// Of a position table.
    pub position: Option<usize>,
    pub blocks: Vec<Block>,
    pub out: Folded,
    pub hidden: usize,
    /// `head.hidden.bias`, and behind it `head.out.weight`, `head.out.bias`.
    pub hidden_bias: usize,
    pub head_out: usize,
    pub head_bias: usize,
    /// Rows (W, w, W', columns) for the kernels `fold` and `unfold`.
    pub table: Vec<[i32; 4]>,
    /// Length of the folded vector.
    pub folded: usize,
    /// Columns of a gathered token, a multiple of 4 as cuBLAS likes its rows aligned.
    pub padded: usize,
    /// Heads handled by one thread block of attention.
    pub group: usize,
}

impl Layout {
    /// Fails with a line if the kernels do not cover the shape.
    pub fn new(config: TransformerConfig) -> Result<Self, LearnError> {
        Self::of(config, config.sequence())
    }

    /// For one token at a time of a network with rotary positions.
    pub fn stream(config: TransformerConfig) -> Result<Self, LearnError> {
        if config.positions != Positions::Rotary || config.embedding > 32 * config.heads {
            return Err(LearnError::Mismatch(format!("a stream wants rotary positions and heads of at most 32 columns: {config:?}")));
        }
        Self::of(config, 1)
    }

    fn of(config: TransformerConfig, tokens: usize) -> Result<Self, LearnError> {
        let TransformerConfig { inputs, outputs, embedding: e, layers, heads, history, head, positions, architecture, .. } = config;
        if architecture != Architecture::Transformer {
            return Err(LearnError::Mismatch(format!("the CUDA engine computes Transformers, no {architecture:?}")));
        }
        config.check().map_err(LearnError::Mismatch)?;
        // Kernels count entries of the flat vector in 31 bits.
        if !e.is_multiple_of(4 * heads) || tokens > 64 || history > 32 || config.parameters() > i32::MAX as usize / 4 {
            return Err(LearnError::Mismatch(format!(
                "the CUDA engine wants windows of at most 32 tokens, sequences of at most 64, and a head width that is a multiple of 4: {config:?}"
            )));
        }
        let mut starts = config.tensors().into_iter().scan(0, |at, t| {
            let start = *at;
            *at += t.len();
            Some(start)
        });
        let mut next = || starts.next().unwrap_or(0);
        let (embed, embed_bias) = (next(), next());
        let position = (positions == Positions::Table).then(&mut next);
        let (mut table, mut folded) = (Vec::new(), 0);
        let mut fold = |norm: usize, plain: usize, width: usize| {
            let f = Folded { plain, folded };
            table.push([plain as i32, norm as i32, folded as i32, width as i32]);
            folded += e * width;
            f
        };
        let mut blocks = Vec::new();
        for _ in 0..layers {
            let (norm_attn, qkv, proj, norm_mlp, up, down) = (next(), next(), next(), next(), next(), next());
            blocks.push(Block { qkv: fold(norm_attn, qkv, 3 * e), proj, up: fold(norm_mlp, up, 4 * e), down });
        }
        let (norm, out) = (next(), next());
        let out = fold(norm, out, e);
        let (hidden, hidden_bias, head_out, head_bias) = (next(), next(), next(), next());
        let group = (1..=heads)
            .rev()
            .find(|&g| heads.is_multiple_of(g) && g * tokens <= 128 && backward_shared(tokens, history, g, e / heads) <= SHARED / 2);
        let group = group.unwrap_or(1);
        if backward_shared(tokens, history, group, e / heads) > SHARED || head * (outputs + 1) + outputs + 1 > SHARED / 4 {
            return Err(LearnError::Mismatch(format!("attention or head too large for the CUDA engine: {config:?}")));
        }
        Ok(Self {
            config,
            tokens,
            parameters: config.parameters(),
            embed,
            embed_bias,
            position,
            blocks,
            out,
            hidden,
            hidden_bias,
            head_out,
            head_bias,
            table,
            folded,
            padded: inputs.next_multiple_of(4),
            group,
        })
    }

    /// The kernels' source with the shape in front of it.
    pub fn source(&self) -> String {
        let TransformerConfig { inputs, outputs, embedding, heads, history, head, .. } = self.config;
        format!(
            "constexpr int E = {embedding}, H = {heads}, T = {}, B = {history}, G = {}, IN = {inputs}, LDX = {}, OUT = {outputs}, HID = {head};\n\
             constexpr bool ROTARY = {};\n{}",
            self.tokens,
            self.group,
            self.padded,
            self.config.positions == Positions::Rotary,
            include_str!("kernels.cu")
        )
    }

    /// Threads and shared bytes (forward, backward) of an attention block.
    pub fn attention(&self) -> (usize, usize, usize) {
        let (t, d) = (self.tokens, self.config.embedding / self.config.heads);
        ((self.group * t).next_multiple_of(32), 4 * t * (3 * self.group * d + 4), backward_shared(t, self.config.history, self.group, d))
    }

    /// Offset of the first block's first tensor.
    pub fn first_block(&self) -> usize {
        self.table[0][1] as usize
    }

    /// Cosine and sine of each pair at each place, `[places][d / 2][2]`; nothing without rotary positions.
    pub fn turns(&self, places: usize) -> Vec<[f32; 2]> {
        let places = if self.config.positions == Positions::Rotary { places } else { 0 };
        (0..places).flat_map(|place| self.config.turn(place)).map(|(cos, sin)| [cos, sin]).collect()
    }

    /// Columns of a row of head gradients and squared error.
    pub fn head_columns(&self) -> usize {
        self.config.head * (self.config.outputs + 1) + self.config.outputs + 1
    }
}

/// Shared bytes of `attention_backward`: q|k|v, output gradient, probabilities and their gradients.
fn backward_shared(t: usize, seen: usize, group: usize, d: usize) -> usize {
    4 * (t * (3 * group * d + 4) + t * (group * d + 4) + 2 * group * t * seen)
}
