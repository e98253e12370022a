//! The learned solver: one network evaluation per frame in place of dynamics, contact forces and integration.
//!
//! The scene's geometry finds contacts, as for every solver. Each frame of an environment is a token in the robot's
//! root frame, and the network ([`Stream`]) remembers the last tokens. A gap in an environment's frames (a reset,
//! frames stepped by another solver, a failed frame) clears its memory.

use nerd_sim::solver::{Fault, Gradients, check, check_kin, commit};
use rayon::prelude::*;

use crate::prelude::*;
use crate::transformer::{Architecture, ForwardError, Stream, even, packed};
use crate::{frame::Frame, program::cpu::Loaded};

/// Number of environments in a chunk, which one thread computes.
const CHUNK: usize = 16;
/// Most environments in one adjoint pass.
const ROWS: usize = 128;

/// A model as a [`Solver`]. In a batch with `[vary]` each environment has its own robot. A model conditioned on
/// parameters receives those drawn for that robot.
pub struct Neural {
    model: Model,
    network: Box<dyn Stream>,
    frames: Vec<Frame>,
    /// Normalised tokens of the frame, `[env][inputs]`.
    tokens: Vec<f32>,
    /// Frame number of each environment's newest token.
    newest: Vec<u64>,
    predictions: Vec<f32>,
    next: Vec<f64>,
    faults: Vec<Fault>,
    /// The network for gradients, loaded at the first request.
    gradients: Option<Loaded>,
}

impl Neural {
    /// A solver with `model`, evaluated by `network`.
    pub fn new(model: Model, network: Box<dyn Stream>) -> Self {
        let frames = Vec::new();
        let tokens = Vec::new();
        let newest = Vec::new();
        let predictions = Vec::new();
        let next = Vec::new();
        let faults = Vec::new();
        Self { model, network, frames, tokens, newest, predictions, next, faults, gradients: None }
    }

    /// A solver with `model`, evaluated on the CPU.
    pub fn on_cpu(model: Model) -> Self {
        let network = packed(&model.weights);
        Self::new(model, network)
    }

    /// Checks a batch. Robots may differ by environment only in a system with `[vary]`.
    fn check(&mut self, batch: &Batch, torques: &[f64]) -> Result<(), StepError> {
        let check = if batch.system.spec.vary.is_some() { check_kin } else { check };
        check(batch, torques, &mut self.faults)
    }

    fn begin(&mut self, batch: &Batch) -> Result<(), StepError> {
        if self.model.config.network.architecture == Architecture::Chain {
            return Err(StepError::Solver(
                "a model of a chain: make its solver with nerd_model::solver::learned".into(),
            ));
        }
        let n = batch.len();
        if self.newest.len() != n {
            self.tokens = vec![0.0; n * self.model.config.network.inputs];
            self.newest = vec![u64::MAX - 1; n];
        }
        while self.frames.len() < n.div_ceil(CHUNK) {
            self.frames.push(Frame::new(&self.model, &batch.system));
        }
        self.frames.truncate(n.div_ceil(CHUNK));
        self.next.resize(batch.states.len(), 0.0);
        Ok(())
    }

    /// Clears the memory of environments with a gap in their frames.
    fn forget(&mut self, batch: &Batch) {
        for (env, (newest, frame)) in self.newest.iter_mut().zip(&batch.frames).enumerate() {
            if *frame == 0 || *newest + 1 != *frame {
                self.network.clear(env);
            }
            *newest = *frame;
        }
    }
}

impl Solver for Neural {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.check(batch, torques)?;
        self.begin(batch)?;
        self.forget(batch);
        let before = &*batch;
        let network = self.model.config.network;
        let aside = &self.faults;
        let chunks = self.tokens.par_chunks_mut(CHUNK * network.inputs).zip(&mut self.frames).enumerate();
        chunks.for_each(|(i, (tokens, frame))| frame.tell(before, torques, aside, i * CHUNK, tokens));

        self.network.push(&self.tokens, &mut self.predictions).map_err(failed)?;

        let size = CHUNK * network.outputs;
        let chunks =
            self.next.par_chunks_mut(size).zip(self.predictions.par_chunks(size)).zip(&mut self.frames).enumerate();
        chunks.for_each(|(i, ((next, predictions), frame))| frame.apply(before, i * CHUNK, predictions, next));
        let done = commit(batch, &mut self.next, &mut self.faults);
        if let Err(StepError::Environments(faults)) = &done {
            faults.iter().for_each(|fault| self.network.clear(fault.env));
        }
        done
    }

    fn vjp(&mut self, batch: &Batch, torques: &[f64], rows: usize, grad_next: &[f64]) -> Result<Gradients, StepError> {
        let config = self.model.config.network;
        if config.architecture != Architecture::Residual {
            return Err(StepError::Refused(
                "this model has no gradients: its network sees more than one frame, take a pure one whose architecture is `residual`"
                    .into(),
            ));
        }
        self.check(batch, torques)?;
        if !self.faults.is_empty() {
            return Err(StepError::Environments(std::mem::take(&mut self.faults)));
        }
        let found = grad_next.len();
        let wanted = batch.len() * rows * 2 * batch.system.robot.nv();
        if found != wanted {
            return Err(StepError::Solver(format!("{found} numbers of gradients, {wanted} are needed")));
        }
        self.begin(batch)?;
        let network = self.gradients.get_or_insert_with(|| Loaded::new(config.program(), &self.model.weights.flat));
        // Larger chunks than for tokens: the network is faster with more rows.
        let size = even(batch.len(), ROWS).max(CHUNK);
        let one = |(i, frame): (usize, &mut Frame)| {
            let envs = (i * size, size.min(batch.len() - i * size));
            frame.back((batch, torques), network, envs, (rows, grad_next))
        };
        let parts: Vec<Gradients> =
            self.frames.par_iter_mut().take(batch.len().div_ceil(size)).enumerate().map(one).collect();
        let mut all = Gradients::default();
        parts.into_iter().for_each(|part| all.append(part));
        Ok(all)
    }

    fn reset(&mut self, env: usize) {
        self.network.clear(env);
    }
}

fn failed(error: ForwardError) -> StepError {
    StepError::Solver(error.to_string())
}
