//! Operations over slots, and programs made of them.

use serde::{Deserialize, Serialize};

/// Index of a slot, a matrix of activations with one row per token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot(pub usize);

/// A tensor of parameters, by its index in [`Program::tensors`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weight(pub usize);

/// Activation function f(x).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// `x (1 + erf(x / sqrt 2)) / 2`.
    Gelu,
    /// `max(x, 0)`.
    Relu,
    /// `tanh x`.
    Tanh,
    /// `x`, or `e^x - 1` below 0.
    Elu,
}

/// Operation of a step, from x, the slot that it reads, to y, the slot that it writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// `y = x diag(scale) W + bias`, or `y += ...` if `add`. `scale` is the weight of the preceding layer norm; engines
    /// fold it into W.
    Linear {
        /// W, `[in, out]`.
        weight: Weight,
        /// Scale of each input, `[in]`.
        scale: Option<Weight>,
        /// Bias of each output, `[out]`.
        bias: Option<Weight>,
        /// Whether to add to y.
        add: bool,
    },
    /// `y = x + P[k]` in place, with k the position of a token in its window.
    Place(Weight),
    /// `y = (x - mean) / sqrt(variance + 1e-5)` per row, with biased variance.
    Norm,
    /// `y = softmax(q k^T / sqrt(d) + M) v` by heads of width d, with `x = [q k v]`; M is 0 for visible tokens and -inf
    /// for others.
    Attend {
        /// Number of heads. Each head has an equal part of the columns of q, k and v.
        heads: usize,
        /// Number of tokens that a token attends to, itself included, with rotary positions. `None`: a token attends to
        /// all tokens of the window up to itself, without rotation.
        band: Option<usize>,
    },
    /// `y_k = [x_{k-d} x_k x_{k+d}]`, with tokens d apart in a window, and zeros beyond the window's ends.
    Neighbours(usize),
    /// `y = f(x)`.
    Activate(Activation),
    /// `y = gelu(a) b` of the halves of `x = [a b]` (Shazeer 2020, arXiv 2002.05202).
    Gate,
}

/// One operation from a slot to a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Slot that the step reads.
    pub from: Slot,
    /// Slot that the step writes.
    pub to: Slot,
    /// The operation.
    pub op: Op,
}

/// A network: parameters and operations. Slot 0 contains the tokens; the last step writes the predictions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Program {
    /// Parameter tensors in the order of the flat vector.
    pub tensors: Vec<TensorSpec>,
    /// Width of every slot.
    pub widths: Vec<usize>,
    /// Operations in order.
    pub steps: Vec<Step>,
    /// Rotary angle (rad) of each column pair of a head per token.
    pub frequencies: Vec<f64>,
}

impl Program {
    /// An empty program for tokens of `inputs` numbers.
    pub fn new(inputs: usize) -> Self {
        Self { widths: vec![inputs], ..Self::default() }
    }

    /// Slot of the tokens.
    pub fn tokens(&self) -> Slot {
        Slot(0)
    }

    /// Slot of the predictions.
    pub fn predictions(&self) -> Slot {
        self.steps.last().map_or(Slot(0), |step| step.to)
    }

    /// Width of a slot.
    pub fn width(&self, slot: Slot) -> usize {
        self.widths[slot.0]
    }

    /// Offset of each tensor in the flat vector, then the total length.
    pub fn starts(&self) -> Vec<usize> {
        let ends = self.tensors.iter().scan(0, |at, t| {
            *at += t.len();
            Some(*at)
        });
        [0].into_iter().chain(ends).collect()
    }

    /// Appends a tensor of parameters; returns its index.
    pub fn tensor(&mut self, name: &str, shape: &[usize], init: Init) -> Weight {
        self.tensors.push(TensorSpec { name: name.into(), shape: shape.to_vec(), init });
        Weight(self.tensors.len() - 1)
    }

    /// Appends a step to a new slot of this width.
    pub fn then(&mut self, from: Slot, width: usize, op: Op) -> Slot {
        self.widths.push(width);
        let to = Slot(self.widths.len() - 1);
        self.steps.push(Step { from, to, op });
        to
    }

    /// Appends `x W + b` to a new slot, with tensors `NAME.weight` and `NAME.bias`.
    pub fn linear(&mut self, name: &str, x: Slot, width: usize, [weights, biases]: [Init; 2]) -> Slot {
        let weight = self.tensor(&format!("{name}.weight"), &[self.width(x), width], weights);
        let bias = Some(self.tensor(&format!("{name}.bias"), &[width], biases));
        self.then(x, width, Op::Linear { weight, scale: None, bias, add: false })
    }

    /// Appends `LN(x) W` to a new slot, with tensors `NORM.weight` and `NAME.weight`; no biases.
    pub fn normed(&mut self, norm: &str, name: &str, x: Slot, width: usize, init: Init) -> Slot {
        let e = self.width(x);
        let scale = Some(self.tensor(&format!("{norm}.weight"), &[e], Init::Constant(1.0)));
        let weight = self.tensor(&format!("{name}.weight"), &[e, width], init);
        let x = self.then(x, e, Op::Norm);
        self.then(x, width, Op::Linear { weight, scale, bias: None, add: false })
    }

    /// Appends the addition of a table of `rows` positions to x, with tensor `NAME.weight`.
    pub fn place(&mut self, name: &str, x: Slot, rows: usize, init: Init) {
        let table = self.tensor(&format!("{name}.weight"), &[rows, self.width(x)], init);
        self.steps.push(Step { from: x, to: x, op: Op::Place(table) });
    }

    /// Appends `to += x W`, with tensor `NAME.weight`.
    pub fn residual(&mut self, name: &str, x: Slot, to: Slot, init: Init) {
        let weight = self.tensor(&format!("{name}.weight"), &[self.width(x), self.width(to)], init);
        self.steps.push(Step { from: x, to, op: Op::Linear { weight, scale: None, bias: None, add: true } });
    }
}

/// Name, shape and initialisation of one tensor.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorSpec {
    /// Dotted name, as in `model.safetensors`.
    pub name: String,
    /// Row-major shape.
    pub shape: Vec<usize>,
    /// Distribution of the initial entries.
    pub init: Init,
}

/// Distribution of a tensor's initial entries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Init {
    /// Normal with mean 0 and this standard deviation.
    Normal(f64),
    /// Uniform in +-1/sqrt(fan_in), the usual initialisation of a linear layer.
    FanIn(usize),
    /// The same value for every entry.
    Constant(f64),
}

impl TensorSpec {
    /// Number of entries.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Stride of token rows on a GPU, a multiple of four: cuBLAS is faster with aligned rows.
pub fn padded(inputs: usize) -> usize {
    inputs.next_multiple_of(4)
}
