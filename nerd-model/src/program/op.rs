//! Operations over named slots, and lists of them.

use serde::{Deserialize, Serialize};

/// Rows of one width, one for each token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot(pub usize);

/// A tensor of parameters, by its number in [`Program::tensors`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weight(pub usize);

/// The activation between two products.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// `x (1 + erf(x / sqrt 2)) / 2`.
    Gelu,
    /// `max(x, 0)`.
    Relu,
    /// `tanh x`.
    Tanh,
    /// `x`, below 0 `e^x - 1`.
    Elu,
}

/// What a step computes: y of the slot it writes from x of the slot it reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// `y = x diag(scale) W + bias`, or `y += ..` if `add`. A layer norm's weight is the `scale` of the next matrix, into which
    /// engines fold it.
    Linear {
        /// W, `[in, out]`.
        weight: Weight,
        /// `[in]`.
        scale: Option<Weight>,
        /// `[out]`.
        bias: Option<Weight>,
        /// Whether it is added to y.
        add: bool,
    },
    /// `y = x + P[k]` in place, k the position of a token in its window.
    Place(Weight),
    /// `y = (x - mean) / sqrt(variance + 1e-5)` of every row, the variance biased.
    Norm,
    /// `y = softmax(q k^T / sqrt(d) + M) v` by heads of width d, with `x = [q k v]`; M is 0 where a token attends to another and -inf
    /// elsewhere.
    Attend {
        /// Equal parts of q, k and v.
        heads: usize,
        /// Number of tokens that a token attends to, itself included, with queries and keys rotated by their positions. None: all older
        /// ones of its window, without rotation.
        band: Option<usize>,
    },
    /// `y_k = [x_{k-d} x_k x_{k+d}]`, d tokens apart in a window, zeros beyond its ends.
    Neighbours(usize),
    /// `y = f(x)`.
    Activate(Activation),
    /// `y = gelu(a) b` of the halves of `x = [a b]` (Shazeer 2020, arXiv 2002.05202).
    Gate,
}

/// One operation between two slots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Slot that is read.
    pub from: Slot,
    /// Slot that is written.
    pub to: Slot,
    /// The operation.
    pub op: Op,
}

/// A network: its parameters and operations. Slot 0 holds tokens, the last step writes predictions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Program {
    /// Parameters in the order of the flat vector.
    pub tensors: Vec<TensorSpec>,
    /// Width of every slot.
    pub widths: Vec<usize>,
    /// In order.
    pub steps: Vec<Step>,
    /// Angle (rad) by which each pair of a head's columns is rotated from one token to the next, for rotary positions.
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

    /// Where tensors begin in the flat vector, and where the last one ends.
    pub fn starts(&self) -> Vec<usize> {
        let ends = self.tensors.iter().scan(0, |at, t| {
            *at += t.len();
            Some(*at)
        });
        [0].into_iter().chain(ends).collect()
    }

    /// A new tensor.
    pub fn tensor(&mut self, name: &str, shape: &[usize], init: Init) -> Weight {
        self.tensors.push(TensorSpec { name: name.into(), shape: shape.to_vec(), init });
        Weight(self.tensors.len() - 1)
    }

    /// A step to a new slot of this width.
    pub fn then(&mut self, from: Slot, width: usize, op: Op) -> Slot {
        self.widths.push(width);
        let to = Slot(self.widths.len() - 1);
        self.steps.push(Step { from, to, op });
        to
    }

    /// `x W + b` in a new slot, of tensors `NAME.weight` and `NAME.bias`.
    pub fn linear(&mut self, name: &str, x: Slot, width: usize, [weights, biases]: [Init; 2]) -> Slot {
        let weight = self.tensor(&format!("{name}.weight"), &[self.width(x), width], weights);
        let bias = Some(self.tensor(&format!("{name}.bias"), &[width], biases));
        self.then(x, width, Op::Linear { weight, scale: None, bias, add: false })
    }

    /// `LN(x) W` in a new slot, of tensors `NORM.weight` and `NAME.weight`; no biases.
    pub fn normed(&mut self, norm: &str, name: &str, x: Slot, width: usize, init: Init) -> Slot {
        let e = self.width(x);
        let scale = Some(self.tensor(&format!("{norm}.weight"), &[e], Init::Constant(1.0)));
        let weight = self.tensor(&format!("{name}.weight"), &[e, width], init);
        let x = self.then(x, e, Op::Norm);
        self.then(x, width, Op::Linear { weight, scale, bias: None, add: false })
    }

    /// `to += x W`, of a tensor `NAME.weight`.
    pub fn residual(&mut self, name: &str, x: Slot, to: Slot, init: Init) {
        let weight = self.tensor(&format!("{name}.weight"), &[self.width(x), self.width(to)], init);
        self.steps.push(Step { from: x, to, op: Op::Linear { weight, scale: None, bias: None, add: true } });
    }
}

/// Name, shape and initial law of one tensor.
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
    /// N(0, sigma).
    Normal(f64),
    /// Uniform in +-1/sqrt(fan_in), the usual law of a linear layer.
    FanIn(usize),
    /// One value.
    Constant(f64),
}

impl TensorSpec {
    /// Number of entries.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Stride of token rows on a GPU: cuBLAS is faster with aligned rows.
pub fn padded(inputs: usize) -> usize {
    inputs.next_multiple_of(4)
}
