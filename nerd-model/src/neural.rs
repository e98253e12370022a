//! The learned solver: one network evaluation a frame in place of dynamics, contact and integration.
//!
//! Contacts are found by the scene's geometry, as for every solver. Each frame of an environment is a token in its own
//! frame of reference, and the network ([`Stream`]) remembers the last ones. A gap in an environment's frames (a reset, frames stepped by
//! another solver, a failed frame) clears that memory.
//!
//! With a base of flight ([`crate::base`]) the prediction is what contact adds to a frame of flight, and environments that can touch
//! nothing within the frame skip the network. Their frames are tokens all the same, as in training, so a landing sees the fall before it.

use std::sync::Arc;

use nerd_sim::batch::Batch;
use nerd_sim::solver::{Fault, Solver, StepError, check, commit};
use nerd_sim::system::System;
use rayon::prelude::*;

use crate::base::Flight;
use crate::folder::Model;
use crate::frame::Frame;
use crate::transformer::{Architecture, Stream, packed};

/// Environments that one thread prepares in a row.
const CHUNK: usize = 16;

/// A model as a [`Solver`].
pub struct Neural {
    model: Model,
    network: Box<dyn Stream>,
    flight: Option<Flight>,
    frames: Vec<Frame>,
    /// Normalised tokens of the frame, `[env][inputs]`.
    tokens: Vec<f32>,
    /// Frame of each environment's newest token.
    newest: Vec<u64>,
    /// Environments whose network is evaluated in this frame.
    asked: Vec<usize>,
    predictions: Vec<f32>,
    next: Vec<f64>,
    faults: Vec<Fault>,
}

impl Neural {
    /// A model of `system`, evaluated by `network`.
    pub fn new(model: Model, system: &Arc<System>, network: Box<dyn Stream>) -> Self {
        let flight = model.config.base.flight(system);
        let (frames, tokens, newest, asked) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (predictions, next, faults) = (Vec::new(), Vec::new(), Vec::new());
        Self { model, network, flight, frames, tokens, newest, asked, predictions, next, faults }
    }

    /// The same, evaluated on the CPU.
    pub fn on_cpu(model: Model, system: &Arc<System>) -> Self {
        let network = packed(&model.weights);
        Self::new(model, system, network)
    }

    /// What was learned, from what.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Environments whose network was evaluated in the last frame; the motion of the others is their base's.
    pub fn asked(&self) -> &[usize] {
        &self.asked
    }

    /// Makes room for a batch, and forgets what was before a gap.
    fn begin(&mut self, batch: &Batch) -> Result<(), StepError> {
        if self.model.config.network.architecture == Architecture::Chain {
            return Err(StepError::Solver("a model of a chain: make its solver with nerd_model::pick::learned".into()));
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
        for (env, (newest, frame)) in self.newest.iter_mut().zip(&batch.frames).enumerate() {
            if *frame == 0 || *newest + 1 != *frame {
                self.network.clear(env);
            }
            *newest = *frame;
        }
        Ok(())
    }
}

impl Solver for Neural {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        check(batch, torques, &mut self.faults)?;
        self.begin(batch)?;
        if let Some(Err(error)) = self.flight.as_mut().map(|flight| flight.step(&batch.states, &batch.scenes, torques)) {
            for fault in error.faults()? {
                if self.faults.iter().all(|other| other.env != fault.env) {
                    self.faults.push(Fault { frame: batch.frames[fault.env], ..fault });
                }
            }
        }
        self.next.clear();
        self.next.extend_from_slice(self.flight.as_ref().map_or(&batch.states, |f| f.states()));
        let (model, before, network) = (&self.model, &*batch, self.model.config.network);
        let (d, aside) = (network.outputs, &self.faults);
        let chunks = self.tokens.par_chunks_mut(CHUNK * network.inputs).zip(self.next.par_chunks(CHUNK * d)).zip(&mut self.frames);
        chunks.enumerate().for_each(|(i, ((tokens, next), frame))| {
            frame.tell(model, before, torques, aside, i * CHUNK, tokens, next);
        });
        self.asked.clear();
        for frame in &self.frames {
            self.asked.extend_from_slice(&frame.asked);
        }

        self.network.push(&self.tokens, &self.asked, &mut self.predictions).map_err(|e| StepError::Solver(e.to_string()))?;

        let (asked, predictions) = (&self.asked, &self.predictions);
        let chunks = self.next.par_chunks_mut(CHUNK * d).zip(&mut self.frames).enumerate();
        chunks.for_each(|(i, (next, frame))| {
            let row = asked.partition_point(|env| *env < i * CHUNK);
            frame.apply(model, before, i * CHUNK, &predictions[row * d..], next);
        });
        let done = commit(batch, &mut self.next, &mut self.faults);
        if let Err(StepError::Environments(faults)) = &done {
            faults.iter().for_each(|fault| self.network.clear(fault.env));
        }
        done
    }

    fn reset(&mut self, env: usize) {
        self.network.clear(env);
    }
}
