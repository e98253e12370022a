//! The fastest evaluator of any network on the CPU.

use burn::tensor::{Device, Tensor, TensorData};

pub use crate::program::Network;
use crate::transformer::{Architecture, Forward, ForwardError, Stream, TransformerConfig, Weights, Windowed, check, packed};

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
