//! [`CudaStream`]: one token of every environment a frame, keys and values of the last ones kept on the device.

use nerd_model::transformer::{ForwardError, Stream, Weights};

use super::Precision;
use super::layout::Layout;
use super::network::Network;
use crate::learner::LearnError;
use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError, Graph};

/// Inference with memory on GPU 0: every frame computes the token of every environment, whatever is asked, so one graph serves.
pub struct CudaStream {
    /// The pass over all environments, once captured.
    graph: Option<Graph>,
    network: Network,
    weights: Buffer<f32>,
    /// Keys and values `[layer][env][history][2 E]`.
    rings: Buffer<f32>,
    turns: Buffer<[f32; 2]>,
    /// Tokens taken of each environment since it was cleared, there and here.
    taken: (Buffer<u32>, Vec<u32>),
    /// Predictions of every environment, there and here.
    predictions: (Buffer<f32>, Vec<f32>),
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
        if weights.flat.len() != layout.parameters || envs == 0 {
            let found = weights.flat.len();
            return Err(LearnError::Mismatch(format!("{found} weights for a network of {}, {envs} environments", layout.parameters)));
        }
        let turns = layout.turns(c.history);
        let network = Network::new(0, layout, envs, precision, false)?;
        let d = &network.device;
        let weights = d.upload(&weights.flat)?;
        network.fold(weights.ptr)?;
        Ok(Self {
            graph: None,
            weights,
            rings: d.zeros(c.layers * envs * c.history * 2 * c.embedding)?,
            turns: d.upload(&turns)?,
            taken: (d.zeros(envs)?, vec![0; envs]),
            predictions: (d.zeros(envs * c.outputs)?, vec![0.0; envs * c.outputs]),
            staging: vec![0.0; envs * network.layout.padded],
            network,
        })
    }

    /// Copies one token `[env][inputs]` of each environment to the device.
    fn load(&mut self, tokens: &[f32]) -> Result<(), LearnError> {
        let (inputs, padded) = (self.network.layout.config.inputs, self.network.layout.padded);
        for (row, token) in self.staging.chunks_exact_mut(padded).zip(tokens.chunks_exact(inputs)) {
            row[..inputs].copy_from_slice(token);
        }
        let d = &self.network.device;
        d.write(&self.network.inputs, &self.staging)?;
        Ok(d.write(&self.taken.0, &self.taken.1)?)
    }

    /// What of a frame the device does: the tokens last loaded to `predictions`.
    pub(super) fn pass(&self) -> Result<(), DeviceError> {
        let (net, w, rows) = (&self.network, self.weights.ptr, self.network.rows);
        let c = net.layout.config;
        let ring = rows * c.history * 2 * c.embedding;
        net.trunk(w, rows, |layer, qkv, out| {
            let args = [Ptr(qkv), Ptr(self.rings.at(layer * ring)), Ptr(self.taken.0.ptr), Ptr(out), Ptr(self.turns.ptr), Int(rows)];
            net.device.launch("attention_stream", ((rows * c.heads).div_ceil(8), 1), (256, 1), 0, &args)
        })?;
        net.top(w, net.x.ptr, rows)?;
        net.predict(w, rows, self.predictions.0.ptr)
    }

    /// The device it is on.
    pub(super) fn device(&self) -> &Device {
        &self.network.device
    }

    /// The same, for more kernels.
    pub(super) fn device_mut(&mut self) -> &mut Device {
        &mut self.network.device
    }

    /// Where tokens `[env][padded]` stand before a pass, predictions after it, and how many tokens were taken, which whoever makes the pass
    /// without [`Stream::push`] counts.
    pub(super) fn tokens(&self) -> u64 {
        self.network.inputs.ptr
    }

    /// See [`CudaStream::tokens`].
    pub(super) fn predictions(&self) -> u64 {
        self.predictions.0.ptr
    }

    /// See [`CudaStream::tokens`].
    pub(super) fn taken(&self) -> u64 {
        self.taken.0.ptr
    }

    /// Empties the memory of some environments whose tokens are counted on the device.
    pub(super) fn forget(&mut self, envs: &[usize]) -> Result<(), DeviceError> {
        if envs.is_empty() {
            return Ok(());
        }
        let (there, here) = &mut self.taken;
        self.network.device.read(there, here)?;
        envs.iter().for_each(|env| here[*env] = 0);
        self.network.device.write(there, here)
    }

    /// Evaluates the tokens last loaded, without copies. For timing.
    ///
    /// # Errors
    /// [`LearnError::Device`] if the device fails.
    pub fn evaluate(&mut self) -> Result<(), LearnError> {
        if self.graph.is_none() {
            // Once outside of a capture, so that libraries have loaded what they load at their first call.
            self.pass()?;
            self.network.device.wait()?;
            self.graph = Some(self.network.device.capture::<DeviceError>(|| self.pass())?);
        }
        self.graph.as_ref().map_or(Ok(()), |graph| Ok(graph.launch("forward pass")?))
    }

    /// Waits for the device.
    ///
    /// # Errors
    /// [`LearnError::Device`] if the device fails.
    pub fn wait(&self) -> Result<(), LearnError> {
        Ok(self.network.device.wait()?)
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
        self.load(tokens)?;
        self.evaluate()?;
        self.taken.1[..envs].iter_mut().for_each(|taken| *taken += 1);
        out.clear();
        if !asked.is_empty() {
            let (there, here) = &mut self.predictions;
            self.network.device.read(there, here)?;
            asked.iter().for_each(|env| out.extend_from_slice(&here[env * c.outputs..][..c.outputs]));
        }
        Ok(())
    }
}

impl Stream for CudaStream {
    fn push(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), ForwardError> {
        self.frame(tokens, asked, out).map_err(|e| ForwardError { message: e.to_string() })
    }

    fn clear(&mut self, env: usize) {
        if let Some(taken) = self.taken.1.get_mut(env) {
            *taken = 0;
        }
    }
}
