//! The Transformer as a burn module, built from and flattened to [`Weights`].
//!
//! The fields stand in the order of [`TransformerConfig::tensors`], so burn's own traversal of a module's parameters
//! is the order of the flat vector: nothing maps names.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Int, Tensor, TensorData, activation::relu};

use super::block::{Block, norm};
use super::config::{Positions, TensorSpec, TransformerConfig};
use super::places::Places;
use super::weights::Weights;

/// The causal Transformer on one device.
#[derive(Module, Debug)]
pub struct Transformer {
    embed_weight: Param<Tensor<2>>,
    embed_bias: Param<Tensor<1>>,
    position: Option<Param<Tensor<2>>>,
    blocks: Vec<Block>,
    norm: Param<Tensor<1>>,
    out: Param<Tensor<2>>,
    hidden_weight: Param<Tensor<2>>,
    hidden_bias: Param<Tensor<1>>,
    head_weight: Param<Tensor<2>>,
    head_bias: Param<Tensor<1>>,
    #[module(skip)]
    config: TransformerConfig,
}

impl Transformer {
    /// The network with these weights on `device`; an autodiff device makes every tensor trainable.
    ///
    /// # Panics
    /// If `weights.flat` is shorter than the configuration asks for.
    pub fn new(weights: &Weights, device: &Device) -> Self {
        let config = weights.config;
        let mut reader = Reader::new(weights, device);
        Self {
            embed_weight: reader.param(),
            embed_bias: reader.param(),
            position: (config.positions == Positions::Table).then(|| reader.param()),
            blocks: (0..config.layers).map(|_| Block::new(&mut reader, config.heads)).collect(),
            norm: reader.param(),
            out: reader.param(),
            hidden_weight: reader.param(),
            hidden_bias: reader.param(),
            head_weight: reader.param(),
            head_bias: reader.param(),
            config,
        }
    }

    /// Shape of the network.
    pub fn config(&self) -> &TransformerConfig {
        &self.config
    }

    /// The parameters as a flat vector; waits for the device.
    pub fn weights(&self) -> Weights {
        let mut visitor = Flatten { flat: Vec::with_capacity(self.config.parameters()) };
        self.visit(&mut visitor);
        Weights { config: self.config, flat: visitor.flat }
    }

    /// Predictions `[windows, tokens, outputs]` for normalised inputs `[windows, tokens, inputs]`.
    ///
    /// Token k sees the tokens 0..=k of its window, of rotary positions the last `history` of them; token 0 is the oldest.
    /// With a table at most `block` tokens.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [windows, tokens, _] = x.dims();
        let places = Places::all(&self.config, tokens, &x.device());
        let x = self.blocks.iter().fold(self.embed(x), |x, b| b.forward(x, tokens, &places));
        self.head(x).reshape([windows, tokens, self.config.outputs])
    }

    /// Predictions `[windows, outputs]` at the token `last[w]` of each window; what stands behind it is not seen.
    pub fn forward_last(&self, x: Tensor<3>, last: &[u32]) -> Tensor<2> {
        let (tokens, device) = (x.dims()[1], x.device());
        let places = Places::all(&self.config, tokens, &device);
        let mut x = self.embed(x);
        let Some((tail, body)) = self.blocks.split_last() else { return self.head(x.select(0, newest_rows(last, tokens, &device))) };
        for block in body {
            x = block.forward(x, tokens, &places);
        }
        let asking = Places::newest(&self.config, last, tokens, &device);
        self.head(tail.forward_last(x, newest_rows(last, tokens, &device), &asking))
    }

    /// `[windows, tokens, inputs]` to rows `[windows * tokens, E]`.
    fn embed(&self, x: Tensor<3>) -> Tensor<2> {
        let ([windows, tokens, inputs], e) = (x.dims(), self.config.embedding);
        let x = x.reshape([windows * tokens, inputs]).matmul(self.embed_weight.val());
        let bias = self.embed_bias.val().unsqueeze();
        let Some(position) = &self.position else { return x + bias };
        let place = position.val().narrow(0, 0, tokens) + bias;
        (x.reshape([windows, tokens, e]) + place.unsqueeze()).reshape([windows * tokens, e])
    }

    /// `[rows, E]` to `[rows, outputs]`.
    fn head(&self, x: Tensor<2>) -> Tensor<2> {
        let x = norm(x, &self.norm).matmul(self.out.val());
        let x = relu(x.matmul(self.hidden_weight.val()) + self.hidden_bias.val().unsqueeze());
        x.matmul(self.head_weight.val()) + self.head_bias.val().unsqueeze()
    }
}

#[cfg(feature = "autodiff")]
impl Transformer {
    /// The gradients of one backward pass in the order of the flat vector; zeros where none was recorded.
    pub fn gradients(&self, gradients: &burn::tensor::Gradients) -> Vec<f32> {
        gradients_of(self, gradients)
    }
}

/// The gradients of a module's parameters in the order of its fields; zeros where none was recorded.
#[cfg(feature = "autodiff")]
pub(crate) fn gradients_of(module: &impl Module, gradients: &burn::tensor::Gradients) -> Vec<f32> {
    let mut visitor = FlattenGradients { flat: Vec::with_capacity(module.num_params()), gradients };
    module.visit(&mut visitor);
    visitor.flat
}

/// Flat rows `w * tokens + last[w]`.
fn newest_rows(last: &[u32], tokens: usize, device: &Device) -> Tensor<1, Int> {
    let rows: Vec<i64> = last.iter().enumerate().map(|(w, &l)| (w * tokens) as i64 + i64::from(l)).collect();
    Tensor::from_data(TensorData::new(rows, [last.len()]), device)
}

/// Hands out the tensors of a flat vector in the configuration's order.
pub(crate) struct Reader<'a> {
    flat: &'a [f32],
    specs: std::vec::IntoIter<TensorSpec>,
    device: &'a Device,
}

impl<'a> Reader<'a> {
    /// From the start of `weights`.
    pub(crate) fn new(weights: &'a Weights, device: &'a Device) -> Self {
        Self { flat: &weights.flat, specs: weights.config.tensors().into_iter(), device }
    }

    /// The next tensor as a trainable parameter.
    pub(crate) fn param<const D: usize>(&mut self) -> Param<Tensor<D>> {
        let spec = self.specs.next().expect("a field for every tensor of the configuration");
        let (entries, rest) = self.flat.split_at(spec.len());
        self.flat = rest;
        Param::from_tensor(Tensor::from_data(TensorData::new(entries.to_vec(), spec.shape), self.device))
    }
}

/// Appends every parameter to a flat vector.
struct Flatten {
    flat: Vec<f32>,
}

impl ModuleVisitor for Flatten {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.flat.extend(param.val().into_data().iter::<f32>());
    }
}

/// Appends every parameter's gradient to a flat vector.
#[cfg(feature = "autodiff")]
struct FlattenGradients<'a> {
    flat: Vec<f32>,
    gradients: &'a burn::tensor::Gradients,
}

#[cfg(feature = "autodiff")]
impl ModuleVisitor for FlattenGradients<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let value = param.val();
        match value.grad(self.gradients) {
            Some(gradient) => self.flat.extend(gradient.into_data().iter::<f32>()),
            None => self.flat.resize(self.flat.len() + value.shape().num_elements(), 0.0),
        }
    }
}
