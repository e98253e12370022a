//! A perceptron over single tokens, to be compared with the Transformer (paper A.3.3.1): a window is one token.
//!
//! `x -> relu(W x + b)` in layers of 4 E, 2 E and E units (the official one has 512, 256, 128), then the head
//! `W_2 relu(W_1 x + b_1) + b_2`. Initial weights and biases uniform in +-1/sqrt(fan in).

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, activation::relu};

use crate::transformer::{Init, Reader, TensorSpec, TransformerConfig, Weights};

/// Layers before the head.
const LAYERS: usize = 3;

/// Tensors in the order of the flat vector.
pub fn tensors(config: &TransformerConfig) -> Vec<TensorSpec> {
    let e = config.embedding;
    let widths = [config.inputs, 4 * e, 2 * e, e, config.head, config.outputs];
    let layer = |(i, w): (usize, &[usize])| {
        let name = if i < LAYERS { format!("layers.{i}") } else { format!("head.{}", ["hidden", "out"][i - LAYERS]) };
        let init = Init::FanIn(w[0]);
        [TensorSpec::new(&format!("{name}.weight"), &[w[0], w[1]], init), TensorSpec::new(&format!("{name}.bias"), &[w[1]], init)]
    };
    widths.windows(2).enumerate().flat_map(layer).collect()
}

/// `x W + b`.
#[derive(Module, Debug)]
pub(crate) struct Linear {
    weight: Param<Tensor<2>>,
    bias: Param<Tensor<1>>,
}

impl Linear {
    pub(crate) fn new(reader: &mut Reader) -> Self {
        Self { weight: reader.param(), bias: reader.param() }
    }

    /// `[rows, in]` to `[rows, out]`.
    pub(crate) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        x.matmul(self.weight.val()) + self.bias.val().unsqueeze()
    }
}

/// The perceptron on one device.
#[derive(Module, Debug)]
pub struct Mlp {
    layers: Vec<Linear>,
}

impl Mlp {
    /// With these weights; an autodiff device makes every tensor trainable.
    pub fn new(weights: &Weights, device: &Device) -> Self {
        let mut reader = Reader::new(weights, device);
        Self { layers: (0..LAYERS + 2).map(|_| Linear::new(&mut reader)).collect() }
    }

    /// `[windows, tokens, inputs]` to `[windows, tokens, outputs]`, each token by itself.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [windows, tokens, inputs] = x.dims();
        let mut x = x.reshape([windows * tokens, inputs]);
        for (i, layer) in self.layers.iter().enumerate() {
            x = layer.forward(if i == 0 { x } else { relu(x) });
        }
        let outputs = x.dims()[1];
        x.reshape([windows, tokens, outputs])
    }
}
