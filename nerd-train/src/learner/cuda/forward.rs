//! [`CudaForward`]: predictions of given weights, for rollouts of many trajectories at once.

use nerd_model::transformer::{Forward, ForwardError, Positions, Weights};

use super::Precision;
use super::layout::Layout;
use super::network::Network;
use crate::learner::LearnError;
use nerd_cuda::Arg::Ptr;
use nerd_cuda::Buffer;
use nerd_cuda::Graph;

/// Inference on GPU 0.
pub struct CudaForward {
    /// Passes by their number of windows: a few sizes, since the number asked for may change every frame.
    graphs: Vec<(usize, Graph)>,
    network: Network,
    weights: Buffer<f32>,
    last: Buffer<u32>,
    selected: Buffer<f32>,
    predictions: Buffer<f32>,
    staging: Vec<f32>,
}

impl CudaForward {
    /// Copies `weights` to the device, with memory for `max_windows` windows.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the kernels do not cover the network's shape, [`LearnError::Device`] if there is
    /// no GPU, a library is missing or memory runs out.
    pub fn new(weights: &Weights, precision: Precision, max_windows: usize) -> Result<Self, LearnError> {
        let c = weights.config;
        if c.positions != Positions::Table {
            return Err(LearnError::Mismatch("rotary positions are evaluated token by token, by CudaStream".into()));
        }
        let layout = Layout::new(c)?;
        if weights.flat.len() != layout.parameters {
            return Err(LearnError::Mismatch(format!("{} weights for a network of {}", weights.flat.len(), layout.parameters)));
        }
        let network = Network::new(0, layout, max_windows, precision, false)?;
        let d = &network.device;
        let (flat, last) = (d.upload(&weights.flat)?, d.zeros(max_windows)?);
        let (selected, predictions) = (d.zeros(max_windows * c.embedding)?, d.zeros(max_windows * c.outputs)?);
        network.fold(flat.ptr)?;
        Ok(Self { graphs: Vec::new(), network, weights: flat, last, selected, predictions, staging: Vec::new() })
    }

    /// Prediction for the newest token of each window.
    ///
    /// `inputs` are `[windows][tokens][inputs]`, normalised, with `tokens <= history`; `last[w]` is the index of
    /// window w's newest token (what stands behind it is not looked at). Returns `[windows][outputs]`.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the sizes do not fit together, [`LearnError::Device`] if the device fails.
    pub fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32]) -> Result<Vec<f32>, LearnError> {
        let (c, padded, windows) = (self.network.layout.config, self.network.layout.padded, last.len());
        if windows == 0 {
            return Ok(Vec::new());
        }
        if tokens > c.history
            || windows > self.network.rows
            || inputs.len() != windows * tokens * c.inputs
            || last.iter().any(|&l| l as usize >= tokens)
        {
            let have = inputs.len();
            return Err(LearnError::Mismatch(format!(
                "{have} inputs for {windows} windows of {tokens} tokens of {} (at most {} windows of {})",
                c.inputs, self.network.rows, c.history
            )));
        }
        let size = windows.next_multiple_of(self.network.rows.div_ceil(8)).min(self.network.rows);
        self.staging.clear();
        self.staging.resize(size * c.history * padded, 0.0);
        for (token, row) in inputs.chunks_exact(c.inputs).enumerate() {
            let at = (token / tokens * c.history + token % tokens) * padded;
            self.staging[at..at + c.inputs].copy_from_slice(row);
        }
        let d = &self.network.device;
        d.write(&self.network.inputs, &self.staging)?;
        let mut rows = last.to_vec();
        rows.resize(size, 0);
        d.write(&self.last, &rows)?;
        if self.graphs.iter().all(|(n, _)| *n != size) {
            self.pass(size)?;
            d.wait()?;
            let graph = d.capture(|| self.pass(size))?;
            self.graphs.push((size, graph));
        }
        if let Some((_, graph)) = self.graphs.iter().find(|(n, _)| *n == size) {
            graph.launch("forward pass")?;
        }
        let mut out = vec![0.0; windows * c.outputs];
        d.read(&self.predictions, &mut out)?;
        Ok(out)
    }

    fn pass(&self, windows: usize) -> Result<(), LearnError> {
        let (net, w) = (&self.network, self.weights.ptr);
        net.windows(w, windows)?;
        net.device.launch("select_rows", (windows, 1), (128, 1), 0, &[Ptr(net.x.ptr), Ptr(self.last.ptr), Ptr(self.selected.ptr)])?;
        net.top(w, self.selected.ptr, windows)?;
        Ok(net.predict(w, windows, self.predictions.ptr)?)
    }
}

impl Forward for CudaForward {
    fn forward(&mut self, inputs: &[f32], tokens: usize, last: &[u32], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        *out = CudaForward::forward(self, inputs, tokens, last).map_err(|e| ForwardError { message: e.to_string() })?;
        Ok(())
    }
}
