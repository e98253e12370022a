//! Vector-Jacobian products of a model's frames on the GPU: the network in f32, everything around it in f64.

use nerd_model::device::gradient_program;
use nerd_sim::articulated::device::{Back, Held, Reach, Trail};

use super::*;

/// Threads of a block, one per environment.
const THREADS: usize = 32;

/// Memory for the backward pass over some frames of a batch of one system. It holds the network's activations in all
/// these frames.
pub(super) struct FramesBack {
    network: Network,
    weights: Buffer<f32>,
    by_tokens: Buffer<f32>,
    frames: usize,
    /// Length of a state (numbers).
    state: usize,
}

/// Refuses a model if its network sees more than one frame.
pub(super) fn goes_back(model: &Model) -> Result<(), StepError> {
    if model.config.network.architecture == Architecture::Residual {
        return Ok(());
    }
    Err(StepError::Refused("this model has no gradients: its network sees more than one frame".into()))
}

impl FramesBack {
    /// Allocates memory for `frames` frames of batches of the size of `batch`.
    pub fn new(model: &Model, batch: &Batch, frames: usize) -> Result<Self, StepError> {
        let config = model.config.network;
        let system = &batch.system;
        let n = batch.len();
        let (mut network, weights) =
            Network::with_weights(Plan::of(&config, 1)?, &model.weights.flat, n * frames, Precision::F32, true)?;
        let text = gradient_program(model.config.form(), &model.normalizer, system, Reach::of(batch));
        network.device.add(&text, &["gradients_look", "gradients_said", "gradients_back"])?;
        let by_tokens = network.device.zeros(n * config.inputs)?;
        Ok(Self { network, weights, by_tokens, frames, state: system.robot.state_dim() })
    }

    /// Whether the memory is enough for `frames` frames.
    pub fn fits(&self, frames: usize) -> bool {
        frames <= self.frames
    }

    /// Queues all work on the streams of `device`.
    pub fn join(&self, device: &Device) -> DeviceResult {
        self.network.device.join(device)
    }

    /// Computes the network's activations in all frames of `trail`.
    pub fn recall(&self, held: &Held, trail: Trail) -> DeviceResult {
        let rows = trail.frames * held.n;
        let tokens = self.network.at(Slot(0));
        let args = args![trail.states, trail.torques, &held.records, &held.scene_of, tokens, rows, held.n];
        self.network.device.launch_each("gradients_look", rows, THREADS, &args)?;
        self.network.forward(self.weights.ptr, rows)
    }

    /// Computes vector-Jacobian products of one frame, for one upstream gradient (row) after the other.
    pub fn back(&self, held: &Held, trail: Trail, back: Back) -> DeviceResult {
        let Self { network, weights, state, .. } = self;
        let n = held.n;
        let rows = back.frame * n..(back.frame + 1) * n;
        let d = &network.device;
        let first = rows.start * state;
        let by_tokens = &self.by_tokens;
        let states = trail.states + 8 * first as u64;
        let said = network.predictions().at(first);
        let Back { grad_next, by_states, by_torques, rows: all, next, .. } = back;
        for row in 0..all {
            let args = args![states, said, grad_next, next[0], network.targets.at(first), all, row, n];
            d.launch_each("gradients_said", n, THREADS, &args)?;
            network.backward(weights.ptr, None, rows.clone(), Some(by_tokens.ptr))?;
            let scenes = &held.records;
            let scene_of = &held.scene_of;
            let read = args![states, scenes, scene_of, said, by_tokens, grad_next, by_states, by_torques, all, row, n];
            d.launch_each("gradients_back", n, THREADS, &read)?;
        }
        Ok(())
    }
}
