//! [`CudaForward`]: predictions of given weights for many windows at once.

use nerd_cuda::{Buffer, Replay};
use nerd_model::program::Op;
use nerd_model::transformer::{Architecture, Forward, ForwardError, Weights};

use super::Precision;
use super::network::Network;
use super::plan::Plan;
use crate::learner::LearnError;

/// Numbers of windows that passes are captured for.
const SIZES: usize = 8;

/// Inference on GPU 0.
pub struct CudaForward {
    /// By how many windows it is over, and whether for their newest tokens alone: a few sizes, since the number asked for may change
    /// every frame.
    passes: Replay<(usize, bool)>,
    network: Network,
    weights: Buffer<f32>,
    last: Buffer<u32>,
}

impl CudaForward {
    /// Copies `weights` to the device, with memory for `max_windows` windows.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the kernels do not cover the network's shape, [`LearnError::Device`] if there is
    /// no GPU, a library is missing or memory runs out.
    pub fn new(weights: &Weights, precision: Precision, max_windows: usize) -> Result<Self, LearnError> {
        let c = weights.config;
        let plan = Plan::of(&c, if c.architecture == Architecture::Chain { c.block } else { c.history })?;
        if plan.program.steps.iter().any(|step| matches!(step.op, Op::Attend { band: Some(_), .. })) {
            return Err(LearnError::Mismatch("rotary positions are evaluated token by token, by CudaStream".into()));
        }
        if weights.flat.len() != plan.parameters() {
            return Err(LearnError::Mismatch(format!("{} weights for a network of {}", weights.flat.len(), plan.parameters())));
        }
        let network = Network::new(nerd_cuda::ordinal(), plan, max_windows, precision, false)?;
        let d = &network.device;
        let (flat, last) = (d.upload(&weights.flat)?, d.zeros(max_windows)?);
        network.fold(flat.ptr)?;
        Ok(Self { passes: Replay::keeping(2 * SIZES), network, weights: flat, last })
    }

    /// Prediction for the newest token of each window.
    ///
    /// `inputs` are `[windows][tokens][inputs]`, normalised, with `tokens <= history`; `last[w]` is the index of
    /// window w's newest token (later ones are not read). Returns `[windows][outputs]`.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the sizes do not fit together, [`LearnError::Device`] if the device fails.
    pub fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32]) -> Result<Vec<f32>, LearnError> {
        let (net, windows) = (&self.network, last.len());
        let (width, history) = (net.plan.inputs(), net.plan.tokens);
        let fits = tokens <= history && windows <= net.rows && inputs.len() == windows * tokens * width;
        if !fits || last.iter().any(|&l| l as usize >= tokens) {
            let have = inputs.len();
            return Err(LearnError::Mismatch(format!(
                "{have} inputs for {windows} windows of {tokens} tokens of {width} (at most {} windows of {history})",
                net.rows
            )));
        }
        if windows == 0 {
            return Ok(Vec::new());
        }
        let mut rows = last.to_vec();
        rows.resize(net.rows, 0);
        net.device.write(&self.last, &rows)?;
        self.evaluate(inputs, tokens, (windows, true))
    }

    /// Predictions `[windows][tokens][outputs]` for all tokens of whole windows `[windows][tokens][inputs]`; a chain's tokens are its rods.
    pub fn all(&mut self, inputs: &[f32]) -> Result<Vec<f32>, LearnError> {
        let (plan, most) = (&self.network.plan, self.network.rows);
        let (window, tokens) = (plan.tokens * plan.inputs(), plan.tokens);
        if !inputs.len().is_multiple_of(window) || inputs.len() > most * window {
            return Err(LearnError::Mismatch(format!("{} inputs are not windows of {window}, or more than {most} of them", inputs.len())));
        }
        if inputs.is_empty() { Ok(Vec::new()) } else { self.evaluate(inputs, tokens, (inputs.len() / window, false)) }
    }

    /// Predictions for windows of so many tokens: of the newest ones, or of all.
    fn evaluate(&mut self, inputs: &[f32], tokens: usize, (windows, newest): (usize, bool)) -> Result<Vec<f32>, LearnError> {
        self.network.load(inputs, tokens)?;
        let (net, w, last) = (&self.network, self.weights.ptr, self.last.ptr);
        let size = windows.next_multiple_of(net.rows.div_ceil(SIZES)).min(net.rows);
        self.passes.run(&net.device, "forward pass", (size, newest), || net.predict(w, size, newest.then_some(last)))?;
        let rows = if newest { windows } else { windows * net.plan.tokens };
        let mut out = vec![0.0; rows * net.plan.outputs()];
        net.device.read(net.predictions(), &mut out)?;
        Ok(out)
    }
}

impl Forward for CudaForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        *out = CudaForward::forward(self, inputs, tokens, last).map_err(|e| ForwardError { message: e.to_string() })?;
        Ok(())
    }
}
