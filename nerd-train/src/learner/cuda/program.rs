//! [`CudaProgram`]: forward and backward passes of any program on a GPU.

use super::*;

/// A program on a GPU over windows of a fixed number of tokens, with memory for a backward pass.
pub struct CudaProgram {
    network: Network,
    weights: Buffer<f32>,
    gradients: Buffer<f32>,
    by_tokens: Buffer<f32>,
}

impl CudaProgram {
    /// Uploads the parameters `flat` and allocates memory for `windows` windows of `tokens` tokens.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the kernels do not cover the program. [`LearnError::Device`] if there is no GPU, a
    /// library is missing or memory runs out.
    pub fn new(
        program: Program,
        flat: &[f32],
        precision: Precision,
        windows: usize,
        tokens: usize,
    ) -> LearnResult<Self> {
        let plan = Plan::new(program, tokens)?;
        let by_tokens = windows * tokens * plan.inputs();
        let (network, weights) = Network::with_weights(plan, flat, windows, precision, true)?;
        let d = &network.device;
        Ok(Self { gradients: d.zeros(flat.len())?, by_tokens: d.zeros(by_tokens)?, weights, network })
    }

    /// Predictions `[windows][tokens][outputs]` for tokens `[windows][tokens][inputs]`. The activations are kept for a
    /// backward pass.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the number of tokens is wrong, or [`LearnError::Device`] if the device fails.
    pub fn forward(&mut self, tokens: &[f32]) -> LearnResult<Vec<f32>> {
        self.pass(tokens, |net, w| net.forward(w, net.rows))
    }

    /// Predictions that no backward pass follows, by a fused kernel if the program has one (small chains).
    pub fn predict(&mut self, tokens: &[f32]) -> LearnResult<Vec<f32>> {
        self.pass(tokens, |net, w| net.predict(w, net.rows))
    }

    fn pass(&mut self, tokens: &[f32], pass: impl Fn(&Network, u64) -> DeviceResult) -> LearnResult<Vec<f32>> {
        if tokens.len() != self.by_tokens.len {
            mismatch!("{} numbers for tokens of {}", tokens.len(), self.by_tokens.len);
        }
        self.network.load(tokens, self.network.plan.tokens)?;
        let net = &self.network;
        pass(net, self.weights.ptr)?;
        let mut predictions = net.device.download(net.predictions())?;
        predictions.truncate(net.rows * net.plan.tokens * net.plan.outputs());
        Ok(predictions)
    }

    /// Gradients of the parameters and of the tokens of the last [`Self::forward`], from the gradient `upstream` of the
    /// predictions.
    pub fn backward(&mut self, upstream: &[f32]) -> LearnResult<(Vec<f32>, Vec<f32>)> {
        let net = &self.network;
        let w = self.weights.ptr;
        net.device.write(&net.targets, upstream)?;
        net.backward(w, Some(self.gradients.ptr), 0..net.rows, Some(self.by_tokens.ptr))?;
        Ok((net.device.download(&self.gradients)?, net.device.download(&self.by_tokens)?))
    }
}
