//! [`CudaStream`]: one token of every environment a frame, keys and values of the last ones kept on the device.

use cudarc::driver::CudaGraph;
use nerd_model::transformer::{ForwardError, Stream, Weights};

use super::Precision;
use super::device::Arg::{Int, Ptr};
use super::device::Buffer;
use super::layout::Layout;
use super::network::Network;
use crate::learner::LearnError;

/// Inference with memory on GPU 0.
pub struct CudaStream {
    /// Passes by their number of rows: a few sizes, since the number asked for may change every frame.
    graphs: Vec<(usize, CudaGraph)>,
    network: Network,
    weights: Buffer<f32>,
    /// Keys and values `[layer][env][history][2 E]`; one more environment takes what padding rows write.
    rings: Buffer<f32>,
    turns: Buffer<[f32; 2]>,
    /// Environment and tokens taken, `[2][rows]`.
    rows: [Buffer<u32>; 2],
    predictions: Buffer<f32>,
    /// Tokens taken of each environment since it was cleared.
    taken: Vec<u32>,
    staging: Vec<f32>,
}

impl CudaStream {
    /// Copies `weights` to the device, with memory for `envs` environments.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if positions are not rotary or the kernels do not cover the network's shape,
    /// [`LearnError::Device`] if there is no GPU, a library is missing or memory runs out.
    pub fn new(weights: &Weights, precision: Precision, envs: usize) -> Result<Self, LearnError> {
        let c = weights.config;
        let layout = Layout::stream(c)?;
        if weights.flat.len() != layout.parameters {
            return Err(LearnError::Mismatch(format!("{} weights for a network of {}", weights.flat.len(), layout.parameters)));
        }
        let turns = layout.turns(c.history);
        let network = Network::new(layout, envs, precision, false)?;
        let d = &network.device;
        let weights = d.upload(&weights.flat)?;
        network.fold(weights.ptr)?;
        Ok(Self {
            graphs: Vec::new(),
            weights,
            rings: d.zeros(c.layers * (envs + 1) * c.history * 2 * c.embedding)?,
            turns: d.upload(&turns)?,
            rows: [d.zeros(envs)?, d.zeros(envs)?],
            predictions: d.zeros(envs * c.outputs)?,
            taken: vec![0; envs],
            staging: Vec::new(),
            network,
        })
    }

    /// Copies one token `[rows][inputs]` of each of the environments `envs` to the device.
    fn load(&mut self, tokens: &[f32], envs: &[usize], size: usize) -> Result<(), LearnError> {
        let (c, padded) = (self.network.layout.config, self.network.layout.padded);
        self.staging.clear();
        self.staging.resize(size * padded, 0.0);
        for (row, env) in self.staging.chunks_exact_mut(padded).zip(envs) {
            row[..c.inputs].copy_from_slice(&tokens[env * c.inputs..(env + 1) * c.inputs]);
        }
        let spare = self.network.rows;
        let mut of: Vec<u32> = envs.iter().map(|env| *env as u32).collect();
        let mut taken: Vec<u32> = envs.iter().map(|env| self.taken[*env]).collect();
        of.resize(size, spare as u32);
        taken.resize(size, 0);
        let d = &self.network.device;
        d.write(&self.network.inputs, &self.staging)?;
        d.write(&self.rows[0], &of)?;
        d.write(&self.rows[1], &taken)
    }

    /// What of a frame the device does: the tokens last loaded to `predictions`.
    fn pass(&self, rows: usize) -> Result<(), LearnError> {
        let (net, w) = (&self.network, self.weights.ptr);
        let c = net.layout.config;
        let ring = (net.rows + 1) * c.history * 2 * c.embedding;
        net.trunk(w, rows, |layer, qkv, out| {
            let args = [Ptr(qkv), Ptr(self.rings.at(layer * ring)), Ptr(self.rows[0].ptr), Ptr(self.rows[1].ptr), Ptr(out)];
            let rest = [Ptr(self.turns.ptr), Int(rows)];
            let grid = ((rows * c.heads).div_ceil(8), 1);
            net.device.launch("attention_stream", grid, (256, 1), 0, &[&args[..], &rest[..]].concat())
        })?;
        net.top(w, net.x.ptr, rows)?;
        net.predict(w, rows, self.predictions.ptr)
    }

    /// Evaluates the tokens last loaded, `rows` of them, without copies. For timing.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if there is no memory for so many, [`LearnError::Device`] if the device fails.
    pub fn evaluate(&mut self, rows: usize) -> Result<(), LearnError> {
        if !(1..=self.network.rows).contains(&rows) {
            return Err(LearnError::Mismatch(format!("{rows} rows in a stream for {}", self.network.rows)));
        }
        if self.graphs.iter().all(|(n, _)| *n != rows) {
            self.pass(rows)?;
            self.network.device.wait()?;
            let graph = self.network.device.capture(|| self.pass(rows))?;
            self.graphs.push((rows, graph));
        }
        match self.graphs.iter().find(|(n, _)| *n == rows) {
            Some((_, graph)) => graph.launch().map_err(super::device::failed("forward pass")),
            None => Ok(()),
        }
    }

    /// Waits for the device.
    ///
    /// # Errors
    /// [`LearnError::Device`] if the device fails.
    pub fn wait(&self) -> Result<(), LearnError> {
        self.network.device.wait()
    }

    fn frame(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), LearnError> {
        let c = self.network.layout.config;
        let envs = tokens.len() / c.inputs;
        if envs * c.inputs != tokens.len() || envs > self.network.rows {
            return Err(LearnError::Mismatch(format!("{} values for at most {} rows of {}", tokens.len(), self.network.rows, c.inputs)));
        }
        if !asked.is_sorted_by(|a, b| a < b) || asked.last().is_some_and(|env| *env >= envs) {
            return Err(LearnError::Mismatch(format!("the environments asked for are not increasing numbers below {envs}")));
        }
        out.clear();
        out.resize(asked.len() * c.outputs, 0.0);
        if !asked.is_empty() {
            let size = asked.len().next_multiple_of(self.network.rows.div_ceil(8)).min(self.network.rows);
            self.load(tokens, asked, size)?;
            self.evaluate(size)?;
            self.network.device.read(&self.predictions, out)?;
        }
        // Who was not asked has a gap in its past, and forgets it.
        let mut asked = asked.iter().peekable();
        for (env, taken) in self.taken.iter_mut().enumerate() {
            *taken = if asked.next_if_eq(&&env).is_some() { *taken + 1 } else { 0 };
        }
        Ok(())
    }
}

impl Stream for CudaStream {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        self.frame(tokens, asked, out).map_err(|e| ForwardError { message: e.to_string() })
    }

    fn clear(&mut self, env: usize) {
        if let Some(taken) = self.taken.get_mut(env) {
            *taken = 0;
        }
    }
}
