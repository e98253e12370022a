//! [`CudaStream`]: one token of every environment a frame, keys and values of the last ones kept on the device.

use nerd_cuda::{Buffer, Device, DeviceError, Replay};
use nerd_model::program::{Op, Slot};
use nerd_model::transformer::{ForwardError, Stream, Weights};

use super::Precision;
use super::network::Network;
use super::plan::Plan;
use crate::learner::LearnError;

/// Inference with memory on GPU 0: every frame computes the token of every environment, whatever is asked, so one graph serves.
pub struct CudaStream {
    /// The pass over all environments.
    replay: Replay,
    network: Network,
    weights: Buffer<f32>,
    /// Keys and values `[attention][env][history][2 E]`.
    rings: Buffer<f32>,
    /// Tokens taken of each environment since it was cleared, there and here.
    taken: (Buffer<u32>, Vec<u32>),
    /// Of every environment.
    predictions: Vec<f32>,
}

impl CudaStream {
    /// Copies `weights` to the device, with memory for `envs` environments.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the network sees windows (positions are a table, cells restart) or the kernels do not cover it,
    /// [`LearnError::Device`] if there is no GPU, a library is missing or memory runs out.
    pub fn new(weights: &Weights, precision: Precision, envs: usize) -> Result<Self, LearnError> {
        let plan = Plan::stream(&weights.config)?;
        if weights.flat.len() != plan.parameters() || envs == 0 {
            let found = weights.flat.len();
            return Err(LearnError::Mismatch(format!("{found} weights for a network of {}, {envs} environments", plan.parameters())));
        }
        let attentions = plan.program.steps.iter().filter(|step| matches!(step.op, Op::Attend { .. })).count();
        let network = Network::new(nerd_cuda::ordinal(), plan, envs, precision, false)?;
        let d = &network.device;
        let weights = d.upload(&weights.flat)?;
        network.fold(weights.ptr)?;
        Ok(Self {
            replay: Replay::default(),
            weights,
            rings: d.zeros(attentions * envs * network.plan.attention.map_or(0, |a| a.ring()))?,
            taken: (d.zeros(envs)?, vec![0; envs]),
            predictions: vec![0.0; envs * network.plan.outputs()],
            network,
        })
    }

    /// Copies one token `[env][inputs]` of each environment to the device.
    fn load(&mut self, tokens: &[f32]) -> Result<(), LearnError> {
        self.network.load(tokens, 1)?;
        Ok(self.network.device.write(&self.taken.0, &self.taken.1)?)
    }

    /// What of a frame the device does: the tokens last loaded to `predictions`.
    pub(super) fn pass(&self) -> Result<(), DeviceError> {
        let net = &self.network;
        let attend = |i: usize, qkv: u64, out: u64| {
            let Some(attention) = net.plan.attention else { return Ok(()) };
            let ring = self.rings.at(i * net.rows * attention.ring());
            attention.stream(&net.device, net.rows, [qkv, ring, self.taken.0.ptr, out, net.turns.ptr])
        };
        net.run(self.weights.ptr, 0..net.plan.parts.len(), &net.addresses(), net.rows, &attend)
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
        self.network.at(Slot(0))
    }

    /// See [`CudaStream::tokens`].
    pub(super) fn predictions(&self) -> u64 {
        self.network.predictions().ptr
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

    fn frame(&mut self, tokens: &[f32], asked: &[usize], out: &mut Vec<f32>) -> Result<(), LearnError> {
        let (inputs, outputs, rows) = (self.network.plan.inputs(), self.network.plan.outputs(), self.network.rows);
        let envs = tokens.len() / inputs;
        if envs * inputs != tokens.len() || envs > rows {
            return Err(LearnError::Mismatch(format!("{} values for at most {rows} rows of {inputs}", tokens.len())));
        }
        if !asked.is_sorted_by(|a, b| a < b) || asked.last().is_some_and(|env| *env >= envs) {
            return Err(LearnError::Mismatch(format!("the environments asked for are not increasing numbers below {envs}")));
        }
        self.load(tokens)?;
        self.replay.run(&self.network.device, "forward pass", (), || self.pass())?;
        self.taken.1[..envs].iter_mut().for_each(|taken| *taken += 1);
        out.clear();
        if !asked.is_empty() {
            self.network.device.read(self.network.predictions(), &mut self.predictions)?;
            asked.iter().for_each(|env| out.extend_from_slice(&self.predictions[env * outputs..][..outputs]));
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
