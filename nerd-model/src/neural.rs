//! The learned solver: one network evaluation a frame in place of dynamics, contact and integration.
//!
//! Contacts are found by the scene's geometry, as for every solver. Of each environment the last h tokens are
//! remembered, each in its own frame; the window grows from one token at a reset. A gap in an environment's frames
//! (a reset, or frames stepped by another solver) empties its window, so history can never be another motion's.
//!
//! With [`Base::Flight`] the prediction is what contact adds to a frame of flight, and environments that can touch nothing
//! within the frame do not evaluate the network.

use std::sync::Arc;

use nerd_core::dynamics::Data;
use nerd_sim::batch::{Batch, contacts};
use nerd_sim::solver::{Solver, StepError, check_torques, commit};
use nerd_sim::system::System;

use crate::base::{Base, Flight};
use crate::features::Features;
use crate::folder::Model;
use crate::network;
use crate::transformer::Forward;

/// A model as a [`Solver`].
pub struct Neural {
    model: Model,
    forward: Box<dyn Forward>,
    features: Features,
    flight: Option<Flight>,
    data: Data,
    events: Vec<nerd_core::contact::ContactEvent>,
    /// Normalised tokens `[env][h][inputs]`, oldest first.
    tokens: Vec<f32>,
    /// Tokens held of each environment.
    held: Vec<usize>,
    /// Frame of each environment's newest token.
    newest: Vec<u64>,
    /// Environments whose network is evaluated in this frame.
    asked: Vec<usize>,
    window: Vec<f32>,
    output: Vec<f32>,
    next: Vec<f64>,
}

impl Neural {
    /// A model of `system`, evaluated by `forward`.
    pub fn new(model: Model, system: &Arc<System>, forward: Box<dyn Forward>) -> Self {
        let (features, data) = (Features::new(system, model.config.form()), Data::new(&system.robot));
        let flight = (model.config.base == Base::Flight).then(|| Flight::new(system));
        let (tokens, held, newest) = (Vec::new(), Vec::new(), Vec::new());
        Self {
            model,
            forward,
            features,
            flight,
            data,
            events: Vec::new(),
            tokens,
            held,
            newest,
            asked: Vec::new(),
            window: Vec::new(),
            output: Vec::new(),
            next: Vec::new(),
        }
    }

    /// The same, evaluated on the CPU.
    pub fn on_cpu(model: Model, system: &Arc<System>) -> Self {
        let forward = network::on_cpu(&model.weights);
        Self::new(model, system, forward)
    }

    /// What was learned, from what.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Appends the token of this frame to an environment's window.
    fn remember(&mut self, batch: &Batch, env: usize, torques: &[f64]) {
        let (h, width) = (self.model.config.network.history, self.model.config.network.inputs);
        let (frame, joints) = (batch.frames[env], batch.system.robot.joint_count());
        if frame == 0 || self.newest[env] + 1 != frame {
            self.held[env] = 0;
        }
        self.newest[env] = frame;
        let ring = &mut self.tokens[env * h * width..(env + 1) * h * width];
        if self.held[env] == h {
            ring.copy_within(width.., 0);
            self.held[env] -= 1;
        }
        let at = self.held[env] * width;
        let (scene, token) = (&batch.scenes[env], &mut ring[at..at + width]);
        self.events.clear();
        if !batch.system.robot.contact_points.is_empty() {
            contacts(&batch.system, scene, batch.state(env), &mut self.data, &mut self.events);
        }
        let tau = &torques[env * joints..(env + 1) * joints];
        let base = self.flight.as_ref().map_or(batch.state(env), |f| f.state(env));
        self.features.token(batch.state(env), base, &self.events, tau, &scene.gravity, token);
        self.model.normalizer.inputs.normalize(token);
        self.held[env] += 1;
    }
}

impl Solver for Neural {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        check_torques(batch, torques)?;
        let network = self.model.config.network;
        let (n, h, width) = (batch.len(), network.history, network.inputs);
        if self.held.len() != n {
            self.tokens = vec![0.0; n * h * width];
            (self.held, self.newest) = (vec![0; n], vec![u64::MAX - 1; n]);
        }
        if let Some(flight) = &mut self.flight {
            flight.step(&batch.states, &batch.scenes, torques)?;
        }
        self.asked.clear();
        for env in 0..n {
            self.remember(batch, env, torques);
            if self.flight.as_mut().is_none_or(|f| f.touches(env, &batch.scenes[env], &self.events)) {
                self.asked.push(env);
            }
        }
        // Windows shorter than the longest are padded behind their newest token, which a causal network cannot see.
        let longest = self.asked.iter().map(|env| self.held[*env]).max().unwrap_or(0);
        self.window.clear();
        for env in &self.asked {
            let ring = &self.tokens[env * h * width..];
            self.window.extend_from_slice(&ring[..longest * width]);
        }
        let last: Vec<u32> = self.asked.iter().map(|env| self.held[*env] as u32 - 1).collect();
        self.output.clear();
        if !last.is_empty() {
            self.forward.forward(&self.window, longest, &last, &mut self.output).map_err(|e| StepError::Solver(e.to_string()))?;
        }
        let d = network.outputs;
        self.next.clear();
        for env in 0..n {
            self.next.extend_from_slice(self.flight.as_ref().map_or(batch.state(env), |f| f.state(env)));
        }
        let (scale, mean) = (self.model.normalizer.outputs.scale(), &self.model.normalizer.outputs.mean);
        let (mut change, mut base) = (vec![0.0; d], vec![0.0; d]);
        for (env, out) in self.asked.iter().zip(self.output.chunks_exact(d)) {
            for (k, c) in change.iter_mut().enumerate() {
                *c = f64::from(out[k]) * scale[k] + mean[k];
            }
            let next = &mut self.next[env * d..(env + 1) * d];
            base.copy_from_slice(next);
            self.features.apply(batch.state(*env), &base, &change, next);
        }
        commit(batch, &mut self.next)
    }

    fn reset(&mut self, env: usize) {
        if let Some(held) = self.held.get_mut(env) {
            *held = 0;
        }
    }
}
