//! [`CudaStream`]: one token per environment and frame; keys and values of the last tokens stay on the GPU.

use super::*;

/// Inference with memory on the GPU: one graph per frame computes the tokens of all environments. A pass reads tokens
/// `[env][padded]` from slot 0. A caller that makes passes without [`Stream::push`] must count the tokens of each
/// environment.
pub struct CudaStream {
    replay: Replay,
    pub(super) network: Network,
    weights: Buffer<f32>,
    /// Keys and values `[attention][env][history][2 E]`.
    rings: Buffer<f32>,
    /// Number of tokens of each environment since its memory was cleared, on the device and on the host.
    pub(super) taken: (Buffer<u32>, Vec<u32>),
}

impl CudaStream {
    /// Uploads `weights` and allocates memory for `envs` environments.
    ///
    /// # Errors
    /// [`LearnError::Mismatch`] if the network sees windows (table of positions) or the kernels do not cover it.
    /// [`LearnError::Device`] if there is no GPU, a library is missing or memory runs out.
    pub fn new(weights: &Weights, precision: Precision, envs: usize) -> LearnResult<Self> {
        let (network, weights) =
            Network::with_weights(Plan::stream(&weights.config)?, &weights.flat, envs, precision, false)?;
        let d = &network.device;
        let plan = &network.plan;
        let attentions = plan.program.steps.iter().filter(|step| matches!(step.op, Op::Attend { .. })).count();
        Ok(Self {
            replay: Replay::default(),
            weights,
            rings: d.zeros(attentions * envs * plan.attention.map_or(0, |a| a.ring()))?,
            taken: (d.zeros(envs)?, vec![0; envs]),
            network,
        })
    }

    /// Device work of one frame: from the tokens in slot 0 to `predictions`.
    pub(super) fn pass(&self) -> DeviceResult {
        let net = &self.network;
        if net.whole.is_some() {
            return net.predict(self.weights.ptr, net.rows);
        }
        let attend = |i: usize, qkv: u64, out: u64| {
            let Some(attention) = net.plan.attention else { return Ok(()) };
            let ring = self.rings.at(i * net.rows * attention.ring());
            attention.stream(&net.device, net.rows, [qkv, ring, self.taken.0.ptr, out, net.rotations.ptr])
        };
        net.run(self.weights.ptr, 0..net.plan.parts.len(), &net.addresses(), net.rows, &attend)
    }

    /// Clears the memory of the environments `envs`, for callers whose kernels count the tokens on the device.
    pub(super) fn forget(&mut self, envs: &[usize]) -> DeviceResult {
        if envs.is_empty() {
            return Ok(());
        }
        let (there, here) = &mut self.taken;
        self.network.device.read(there, here)?;
        envs.iter().for_each(|env| here[*env] = 0);
        self.network.device.write(there, here)
    }

    fn frame(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> LearnResult {
        let inputs = self.network.plan.inputs();
        let outputs = self.network.plan.outputs();
        let rows = self.network.rows;
        let envs = tokens.len() / inputs;
        if envs * inputs != tokens.len() || envs > rows {
            mismatch!("{} values for at most {rows} rows of {inputs}", tokens.len());
        }
        self.network.load(tokens, 1)?;
        self.network.device.write(&self.taken.0, &self.taken.1)?;
        self.replay.run(&self.network.device, "forward pass", (), || self.pass())?;
        self.taken.1[..envs].iter_mut().for_each(|taken| *taken += 1);
        out.resize(rows * outputs, 0.0);
        self.network.device.read(self.network.predictions(), out)?;
        out.truncate(envs * outputs);
        Ok(())
    }
}

impl Stream for CudaStream {
    fn push(&mut self, tokens: &[f32], out: &mut Vec<f32>) -> ForwardResult {
        Ok(self.frame(tokens, out)?)
    }

    fn clear(&mut self, env: usize) {
        if let Some(taken) = self.taken.1.get_mut(env) {
            *taken = 0;
        }
    }
}
