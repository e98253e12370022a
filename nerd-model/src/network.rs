//! Any of the networks: one burn module to train, one evaluator on the CPU.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use crate::mlp::Mlp;
use crate::recurrent::Recurrent;
use crate::transformer::{Architecture, Forward, ForwardError, Stream, Transformer, TransformerConfig, Weights, Windowed, check, packed};

/// A network of any [`Architecture`] on one device.
// One of them a thread: a box would save nothing.
#[allow(clippy::large_enum_variant)]
#[derive(Module, Debug)]
pub enum Network {
    /// The causal Transformer.
    Transformer(Transformer),
    /// A perceptron over single tokens.
    Mlp(Mlp),
    /// GRU or LSTM.
    Recurrent(Recurrent),
}

impl Network {
    /// With these weights on `device`; an autodiff device makes every tensor trainable.
    pub fn new(weights: &Weights, device: &Device) -> Self {
        match weights.config.architecture {
            Architecture::Transformer => Self::Transformer(Transformer::new(weights, device)),
            Architecture::Mlp => Self::Mlp(Mlp::new(weights, device)),
            Architecture::Gru | Architecture::Lstm => Self::Recurrent(Recurrent::new(weights, device)),
        }
    }

    /// Predictions `[windows, tokens, outputs]` for normalised inputs `[windows, tokens, inputs]`, oldest token first; none sees
    /// a younger one.
    pub fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        match self {
            Self::Transformer(network) => network.forward(x),
            Self::Mlp(network) => network.forward(x),
            Self::Recurrent(network) => network.forward(x),
        }
    }

    /// The gradients of one backward pass in the order of the flat vector; zeros where none was recorded.
    #[cfg(feature = "autodiff")]
    pub fn gradients(&self, gradients: &burn::tensor::Gradients) -> Vec<f32> {
        crate::transformer::gradients_of(self, gradients)
    }
}

/// The fastest evaluator on the CPU.
pub fn on_cpu(weights: &Weights) -> Box<dyn Stream> {
    match weights.config.architecture {
        Architecture::Transformer => packed(weights),
        _ => Box::new(Windowed::new(PlainForward::new(weights), weights.config)),
    }
}

/// [`Forward`] of any network through burn: whole windows, cut in a piece for each thread.
#[derive(Debug)]
pub struct PlainForward {
    network: Network,
    config: TransformerConfig,
    device: Device,
}

impl PlainForward {
    /// The network with these weights, on the CPU.
    pub fn new(weights: &Weights) -> Self {
        let device = crate::BurnDevice::flex();
        Self { network: Network::new(weights, &device), config: weights.config, device }
    }

    fn piece(&self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut [f32]) -> Result<(), ForwardError> {
        let (width, outputs) = (self.config.inputs, self.config.outputs);
        let x = Tensor::from_data(TensorData::new(inputs.to_vec(), [last.len(), tokens, width]), &self.device);
        let y = self.network.forward(x).try_into_data().map_err(|e| ForwardError { message: format!("{e:?}") })?;
        let y: Vec<f32> = y.iter::<f32>().collect();
        for ((out, y), l) in out.chunks_exact_mut(outputs).zip(y.chunks_exact(tokens * outputs)).zip(last) {
            out.copy_from_slice(&y[*l as usize * outputs..][..outputs]);
        }
        Ok(())
    }
}

impl Forward for PlainForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        check(&self.config, inputs, tokens, last)?;
        out.clear();
        out.resize(last.len() * self.config.outputs, 0.0);
        let piece = last.len().div_ceil(rayon::current_num_threads()).max(1);
        let pieces = inputs.chunks(piece * tokens * self.config.inputs).zip(last.chunks(piece));
        let this = &*self;
        // Plain threads: burn waits inside its own locks, where a rayon thread might take up other work.
        std::thread::scope(|scope| {
            let work: Vec<_> = pieces
                .zip(out.chunks_mut(piece * this.config.outputs))
                .map(|((x, l), o)| scope.spawn(move || this.piece(x, tokens, l, o)))
                .collect();
            let lost = || Err(ForwardError { message: "a worker thread panicked".into() });
            // Every thread is waited for, also behind a failed one.
            let done: Vec<_> = work.into_iter().map(|w| w.join().unwrap_or_else(|_| lost())).collect();
            done.into_iter().collect()
        })
    }
}
