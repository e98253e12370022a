//! [`CudaProgram`]: any program on a GPU, forward and backward.

use nerd_cuda::Buffer;
use nerd_model::program::Program;

use super::Precision;
use super::network::Network;
use super::plan::Plan;
use crate::learner::LearnError;

/// A program over windows on GPU 0, with all that the way back needs.
pub struct CudaProgram {
    network: Network,
    weights: Buffer<f32>,
    gradients: Buffer<f32>,
    by_tokens: Buffer<f32>,
}

impl CudaProgram {
    /// With its parameters, for `windows` windows of so many tokens.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the kernels do not cover the program, [`LearnError::Device`] if there is no GPU, a library is missing
    /// or memory runs out.
    pub fn new(program: Program, flat: &[f32], precision: Precision, windows: usize, tokens: usize) -> Result<Self, LearnError> {
        let plan = Plan::new(program, tokens, false)?;
        if flat.len() != plan.parameters() {
            return Err(LearnError::Mismatch(format!("{} weights for a program of {}", flat.len(), plan.parameters())));
        }
        let network = Network::new(nerd_cuda::ordinal(), plan, windows, precision, true)?;
        let d = &network.device;
        let (weights, gradients) = (d.upload(flat)?, d.zeros(flat.len())?);
        let by_tokens = d.zeros(windows * tokens * network.plan.inputs())?;
        Ok(Self { weights, gradients, by_tokens, network })
    }

    /// Predictions `[windows][tokens][outputs]` for tokens `[windows][tokens][inputs]`, whose activations are kept.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if there are more or fewer tokens, [`LearnError::Device`] if the device fails.
    pub fn forward(&mut self, tokens: &[f32]) -> Result<Vec<f32>, LearnError> {
        if tokens.len() != self.by_tokens.len {
            return Err(LearnError::Mismatch(format!("{} numbers for tokens of {}", tokens.len(), self.by_tokens.len)));
        }
        self.network.load(tokens, self.network.plan.tokens)?;
        let (net, w) = (&self.network, self.weights.ptr);
        net.fold(w)?;
        net.windows(w, net.rows)?;
        let mut said = net.device.download(net.predictions())?;
        said.truncate(net.rows * net.plan.tokens * net.plan.outputs());
        Ok(said)
    }

    /// Gradients by the parameters and by the tokens last passed, from that by their predictions.
    pub fn backward(&mut self, behind: &[f32]) -> Result<(Vec<f32>, Vec<f32>), LearnError> {
        let (net, w) = (&self.network, self.weights.ptr);
        net.device.write(&net.targets, behind)?;
        net.backward(w, self.gradients.ptr, net.rows, Some(self.by_tokens.ptr))?;
        Ok((net.device.download(&self.gradients)?, net.device.download(&self.by_tokens)?))
    }
}
