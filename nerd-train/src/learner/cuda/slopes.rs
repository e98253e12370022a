//! The way back over a model's frames on the device, in f32 around the network in f64.

use nerd_model::device::slope_program;
use nerd_sim::articulated::device::{Back, Held, Reach, Trail, failed};

use super::*;

/// Threads of a block, an environment each.
const THREADS: usize = 32;

/// The network's activations in a number of frames of a batch of one system, kept for the backward pass over each frame.
pub(super) struct FramesBack {
    network: Network,
    weights: Buffer<f32>,
    by_tokens: Buffer<f32>,
    frames: usize,
    /// Numbers of a state.
    state: usize,
}

/// Refuses a model whose network sees more than one frame.
pub(super) fn goes_back(model: &Model) -> Result<(), StepError> {
    if model.config.network.architecture == Architecture::Residual {
        return Ok(());
    }
    Err(StepError::Refused("this model has no slopes: its network sees more than one frame".into()))
}

impl FramesBack {
    /// Allocates for `frames` frames of batches like this one.
    pub(super) fn new(model: &Model, batch: &Batch, frames: usize) -> Result<Self, StepError> {
        let (config, system, n) = (model.config.network, &batch.system, batch.len());
        let solver = |e: LearnError| StepError::Solver(e.to_string());
        let plan = Plan::of(&config, 1).map_err(solver)?;
        let (mut network, weights) = Network::with_weights(plan, &model.weights.flat, n * frames, Precision::F32, true).map_err(solver)?;
        let text = slope_program(model.config.form(), &model.normalizer, system, Reach::of(batch));
        network.device.add(&text, &["slopes_look", "slopes_said", "slopes_back"]).map_err(failed)?;
        let by_tokens = network.device.zeros(n * config.inputs).map_err(failed)?;
        Ok(Self { network, weights, by_tokens, frames, state: system.robot.state_dim() })
    }

    /// Whether there is room for `frames` frames.
    pub(super) fn fits(&self, frames: usize) -> bool {
        frames <= self.frames
    }

    /// Does its work in the order of another device's.
    pub(super) fn join(&self, device: &Device) -> Result<(), DeviceError> {
        self.network.device.join(device)
    }

    fn each(&self, kernel: &str, n: usize, args: &[Arg]) -> Result<(), DeviceError> {
        self.network.device.launch(kernel, (n.div_ceil(THREADS), 1), (THREADS, 1), 0, args)
    }

    /// What the network said in all of these frames.
    pub(super) fn recall(&self, held: &Held, trail: Trail) -> Result<(), DeviceError> {
        let rows = trail.frames * held.n;
        let world = [trail.states, trail.torques, held.records.ptr, held.scene_of.ptr, self.network.at(Slot(0))].map(Ptr);
        self.each("slopes_look", rows, &[&world[..], &[Int(rows), Int(held.n)]].concat())?;
        self.network.forward(self.weights.ptr, rows)
    }

    /// Back over one of them, gradient by gradient.
    pub(super) fn back(&self, held: &Held, trail: Trail, back: Back) -> Result<(), DeviceError> {
        let (Self { network, weights, state, .. }, n) = (self, held.n);
        let rows = back.frame * n..(back.frame + 1) * n;
        let (states, said) = (Ptr(trail.states + 8 * (rows.start * state) as u64), network.predictions().at(rows.start * state));
        let [scenes, scene_of, said, by_tokens] = [held.records.ptr, held.scene_of.ptr, said, self.by_tokens.ptr].map(Ptr);
        let [by_next, by_states, by_torques] = [back.by_next, back.by_states, back.by_torques].map(Ptr);
        for row in 0..back.rows {
            let which = [back.rows, row, n].map(Int);
            let written = [Ptr(back.next[0]), Ptr(network.targets.at(rows.start * state))];
            self.each("slopes_said", n, &[&[states, said, by_next][..], &written, &which].concat())?;
            network.backward(weights.ptr, None, rows.clone(), Some(self.by_tokens.ptr))?;
            let read = [states, scenes, scene_of, said, by_tokens, by_next];
            self.each("slopes_back", n, &[&read[..], &[by_states, by_torques], &which].concat())?;
        }
        Ok(())
    }
}
