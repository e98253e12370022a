//! [`CudaForward`]: predictions of fixed weights for many windows at once.

use nerd_model::transformer::Forward;

use super::*;

/// Largest number of batch sizes with a captured graph.
const SIZES: usize = 8;

/// Inference on windows, on the GPU.
pub struct CudaForward {
    /// Graphs by number of windows. The number is rounded up to a few sizes, since it may change every frame.
    passes: Replay<usize>,
    network: Network,
    weights: Buffer<f32>,
    last: Buffer<u32>,
}

impl CudaForward {
    /// Uploads `weights` and allocates memory for `max_windows` windows.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the network's shape has no kernels. [`LearnError::Device`] if there is no GPU, a
    /// library is missing or memory runs out.
    pub fn new(weights: &Weights, precision: Precision, max_windows: usize) -> LearnResult<Self> {
        let plan = Plan::of(&weights.config, weights.config.history)?;
        if plan.program.steps.iter().any(|step| matches!(step.op, Op::Attend { band: Some(_), .. })) {
            mismatch!("rotary positions are evaluated token by token, by CudaStream");
        }
        let (network, weights) = Network::with_weights(plan, &weights.flat, max_windows, precision, false)?;
        Ok(Self { passes: Replay::keeping(SIZES), last: network.device.zeros(max_windows)?, network, weights })
    }

    fn newest(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> LearnResult {
        let width = self.network.plan.inputs();
        let history = self.network.plan.tokens;
        let windows = last.len();
        let most = self.network.rows;
        let fits = tokens <= history && windows <= most && inputs.len() == windows * tokens * width;
        if !fits || last.iter().any(|&l| l as usize >= tokens) {
            let have = inputs.len();
            mismatch!(
                "{have} inputs for {windows} windows of {tokens} tokens of {width} (at most {most} windows of {history})"
            );
        }
        out.clear();
        out.resize(windows * self.network.plan.outputs(), 0.0);
        if windows == 0 {
            return Ok(());
        }
        self.network.load(inputs, tokens)?;
        let net = &self.network;
        let w = self.weights.ptr;
        let at = self.last.ptr;
        let mut rows = last.to_vec();
        rows.resize(most, 0);
        net.device.write(&self.last, &rows)?;
        let size = windows.next_multiple_of(most.div_ceil(SIZES)).min(most);
        self.passes.run(&net.device, "forward pass", size, || net.predict_one(w, size, at))?;
        Ok(net.device.read(net.predictions(), out)?)
    }
}

impl Forward for CudaForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> ForwardResult {
        Ok(self.newest(inputs, tokens, last, out)?)
    }
}
