//! Recurrent networks over the tokens of a window, to be compared with the Transformer (paper A.3.3.1).
//!
//! Cells of width E one above the other, then the head `W_2 relu(W_1 x + b_1) + b_2`. With `u = W x + b` of the token and
//! `v = U h + c` of the state, both split by gate, a GRU's cell is (Cho and others 2014, as in PyTorch)
//!
//! ```text
//! r = s(u_r + v_r)   z = s(u_z + v_z)   n = tanh(u_n + r v_n)   h' = n + z (h - n)
//! ```
//!
//! and an LSTM's (Hochreiter and Schmidhuber 1997, with forget gate)
//!
//! ```text
//! i, f, o = s(u + v)   g = tanh(u_g + v_g)   c' = f c + i g   h' = o tanh(c')
//! ```
//!
//! The state is zero before the oldest token of a window, in training and in rollouts alike. Initial weights and biases
//! uniform in +-1/sqrt(E), as PyTorch's.

use burn::module::{Module, Param};
use burn::tensor::{
    Device, Tensor,
    activation::{relu, sigmoid},
};

use crate::mlp::Linear;
use crate::transformer::{Architecture, Init, Reader, TensorSpec, TransformerConfig, Weights};

/// Gates of a cell, the candidate counted.
fn gates(architecture: Architecture) -> usize {
    if architecture == Architecture::Lstm { 4 } else { 3 }
}

/// Tensors in the order of the flat vector.
pub fn tensors(config: &TransformerConfig) -> Vec<TensorSpec> {
    let (e, g) = (config.embedding, gates(config.architecture));
    let mut t = Vec::new();
    for i in 0..config.layers {
        let below = if i == 0 { config.inputs } else { e };
        let mut cell = |name: &str, shape: &[usize]| t.push(TensorSpec::new(&format!("cells.{i}.{name}"), shape, Init::FanIn(e)));
        cell("token.weight", &[below, g * e]);
        cell("token.bias", &[g * e]);
        cell("state.weight", &[e, g * e]);
        cell("state.bias", &[g * e]);
    }
    t.push(TensorSpec::new("head.hidden.weight", &[e, config.head], Init::FanIn(e)));
    t.push(TensorSpec::new("head.hidden.bias", &[config.head], Init::FanIn(e)));
    t.push(TensorSpec::new("head.out.weight", &[config.head, config.outputs], Init::FanIn(config.head)));
    t.push(TensorSpec::new("head.out.bias", &[config.outputs], Init::FanIn(config.head)));
    t
}

/// One cell, of either kind.
#[derive(Module, Debug)]
struct Cell {
    token: Linear,
    state_weight: Param<Tensor<2>>,
    state_bias: Param<Tensor<1>>,
    lstm: bool,
}

impl Cell {
    /// `[windows, tokens, in]` to `[windows, tokens, E]`.
    fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [windows, tokens, inputs] = x.dims();
        let e = self.state_weight.dims()[0];
        let width = self.state_weight.dims()[1];
        // What tokens say is one product for all of them; only states wait for each other.
        let u = self.token.forward(x.reshape([windows * tokens, inputs])).reshape([windows, tokens, width]);
        let mut h = Tensor::<2>::zeros([windows, e], &u.device());
        let mut c = h.clone();
        let mut states = Vec::with_capacity(tokens);
        for k in 0..tokens {
            let u = u.clone().narrow(1, k, 1).reshape([windows, width]);
            let v = h.clone().matmul(self.state_weight.val()) + self.state_bias.val().unsqueeze();
            let gate = |x: &Tensor<2>, i: usize| x.clone().narrow(1, i * e, e);
            if self.lstm {
                let x = u + v;
                let [i, f, o] = [0, 1, 3].map(|k| sigmoid(gate(&x, k)));
                c = f * c + i * gate(&x, 2).tanh();
                h = o * c.clone().tanh();
            } else {
                let [r, z] = [0, 1].map(|k| sigmoid(gate(&u, k) + gate(&v, k)));
                let n = (gate(&u, 2) + r * gate(&v, 2)).tanh();
                h = n.clone() + z * (h - n);
            }
            states.push(h.clone());
        }
        Tensor::stack(states, 1)
    }
}

/// The recurrent network on one device.
#[derive(Module, Debug)]
pub struct Recurrent {
    cells: Vec<Cell>,
    hidden: Linear,
    out: Linear,
}

impl Recurrent {
    /// With these weights; an autodiff device makes every tensor trainable.
    pub fn new(weights: &Weights, device: &Device) -> Self {
        let mut reader = Reader::new(weights, device);
        let lstm = weights.config.architecture == Architecture::Lstm;
        let cell =
            |reader: &mut Reader| Cell { token: Linear::new(reader), state_weight: reader.param(), state_bias: reader.param(), lstm };
        let cells = (0..weights.config.layers).map(|_| cell(&mut reader)).collect();
        Self { cells, hidden: Linear::new(&mut reader), out: Linear::new(&mut reader) }
    }

    /// `[windows, tokens, inputs]` to `[windows, tokens, outputs]`; token k sees the tokens 0..=k of its window.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let x = self.cells.iter().fold(x, |x, cell| cell.forward(x));
        let [windows, tokens, e] = x.dims();
        let x = self.out.forward(relu(self.hidden.forward(x.reshape([windows * tokens, e]))));
        let outputs = x.dims()[1];
        x.reshape([windows, tokens, outputs])
    }
}
