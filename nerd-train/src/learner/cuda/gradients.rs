//! Vector-Jacobian products of a model's frames on the GPU: the network in f32, everything around it in f64.

use nerd_model::device::gradient_program;
use nerd_sim::articulated::device::{Back, Held, Reach, Trail, failed};

use super::*;

/// Threads of a block, one per environment.
const THREADS: usize = 32;

/// Memory for the backward pass over some frames of a batch of one system: the network's activations in all of them.
pub(super) struct FramesBack {
    network: Network,
    weights: Buffer<f32>,
    by_tokens: Buffer<f32>,
    frames: usize,
    /// Numbers in a state.
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
    /// Allocates memory for `frames` frames of batches like `batch`.
    pub(super) fn new(model: &Model, batch: &Batch, frames: usize) -> Result<Self, StepError> {
        let (config, system, n) = (model.config.network, &batch.system, batch.len());
        let solver = |e: LearnError| StepError::Solver(e.to_string());
        let plan = Plan::of(&config, 1).map_err(solver)?;
        let (mut network, weights) =
            Network::with_weights(plan, &model.weights.flat, n * frames, Precision::F32, true).map_err(solver)?;
        let text = gradient_program(model.config.form(), &model.normalizer, system, Reach::of(batch));
        network.device.add(&text, &["gradients_look", "gradients_said", "gradients_back"]).map_err(failed)?;
        let by_tokens = network.device.zeros(n * config.inputs).map_err(failed)?;
        Ok(Self { network, weights, by_tokens, frames, state: system.robot.state_dim() })
    }

    /// Whether the memory is enough for `frames` frames.
    pub(super) fn fits(&self, frames: usize) -> bool {
        frames <= self.frames
    }

    /// Queues all work on the streams of `device`.
    pub(super) fn join(&self, device: &Device) -> Result<(), DeviceError> {
        self.network.device.join(device)
    }

    fn each(&self, kernel: &str, n: usize, args: &[Arg]) -> Result<(), DeviceError> {
        self.network.device.launch(kernel, (n.div_ceil(THREADS), 1), (THREADS, 1), 0, args)
    }

    /// Computes the network's activations in all frames of `trail`.
    pub(super) fn recall(&self, held: &Held, trail: Trail) -> Result<(), DeviceError> {
        let rows = trail.frames * held.n;
        let world =
            [trail.states, trail.torques, held.records.ptr, held.scene_of.ptr, self.network.at(Slot(0))].map(Ptr);
        self.each("gradients_look", rows, &[&world[..], &[Int(rows), Int(held.n)]].concat())?;
        self.network.forward(self.weights.ptr, rows)
    }

    /// Vector-Jacobian products of one frame, one gradient (row) after the other.
    pub(super) fn back(&self, held: &Held, trail: Trail, back: Back) -> Result<(), DeviceError> {
        let (Self { network, weights, state, .. }, n) = (self, held.n);
        let rows = back.frame * n..(back.frame + 1) * n;
        let (states, said) =
            (Ptr(trail.states + 8 * (rows.start * state) as u64), network.predictions().at(rows.start * state));
        let [scenes, scene_of, said, by_tokens] =
            [held.records.ptr, held.scene_of.ptr, said, self.by_tokens.ptr].map(Ptr);
        let [grad_next, by_states, by_torques] = [back.grad_next, back.by_states, back.by_torques].map(Ptr);
        for row in 0..back.rows {
            let which = [back.rows, row, n].map(Int);
            let written = [Ptr(back.next[0]), Ptr(network.targets.at(rows.start * state))];
            self.each("gradients_said", n, &[&[states, said, grad_next][..], &written, &which].concat())?;
            network.backward(weights.ptr, None, rows.clone(), Some(self.by_tokens.ptr))?;
            let read = [states, scenes, scene_of, said, by_tokens, grad_next];
            self.each("gradients_back", n, &[&read[..], &[by_states, by_torques], &which].concat())?;
        }
        Ok(())
    }
}
