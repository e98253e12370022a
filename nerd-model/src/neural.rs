//! The learned solver: one network evaluation a frame in place of dynamics, contact and integration.
//!
//! Contacts are found by the scene's geometry, as for every solver. Each frame of an environment is a token in its own
//! frame of reference, and the network ([`Stream`]) remembers the last ones. A gap in an environment's frames (a reset, or
//! frames stepped by another solver) makes it forget them, so history can never be another motion's.
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
use crate::transformer::{Stream, packed};

/// A model as a [`Solver`].
pub struct Neural {
    model: Model,
    network: Box<dyn Stream>,
    features: Features,
    flight: Option<Flight>,
    data: Data,
    events: Vec<nerd_core::contact::ContactEvent>,
    /// Normalised tokens of the frame, `[env][inputs]`.
    tokens: Vec<f32>,
    /// Frame of each environment's newest token.
    newest: Vec<u64>,
    /// Environments whose network is evaluated in this frame.
    asked: Vec<usize>,
    output: Vec<f32>,
    next: Vec<f64>,
}

impl Neural {
    /// A model of `system`, evaluated by `network`.
    pub fn new(model: Model, system: &Arc<System>, network: Box<dyn Stream>) -> Self {
        let (features, data) = (Features::new(system, model.config.base), Data::new(&system.robot));
        let flight = (model.config.base == Base::Flight).then(|| Flight::new(system));
        let (tokens, newest, asked) = (Vec::new(), Vec::new(), Vec::new());
        let (events, output, next) = (Vec::new(), Vec::new(), Vec::new());
        Self { model, network, features, flight, data, events, tokens, newest, asked, output, next }
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

    /// Writes the token of this frame.
    fn tell(&mut self, batch: &Batch, env: usize, torques: &[f64]) {
        let (width, joints) = (self.model.config.network.inputs, batch.system.robot.joint_count());
        let frame = batch.frames[env];
        if frame == 0 || self.newest[env] + 1 != frame {
            self.network.clear(env);
        }
        self.newest[env] = frame;
        let (scene, token) = (&batch.scenes[env], &mut self.tokens[env * width..(env + 1) * width]);
        self.events.clear();
        if !batch.system.robot.contact_points.is_empty() {
            contacts(&batch.system, scene, batch.state(env), &mut self.data, &mut self.events);
        }
        let tau = &torques[env * joints..(env + 1) * joints];
        let base = self.flight.as_ref().map_or(batch.state(env), |f| f.state(env));
        self.features.token(batch.state(env), base, &self.events, tau, &scene.gravity, token);
        self.model.normalizer.inputs.normalize(token);
    }
}

impl Solver for Neural {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        check_torques(batch, torques)?;
        let network = self.model.config.network;
        let n = batch.len();
        if self.newest.len() != n {
            self.tokens = vec![0.0; n * network.inputs];
            self.newest = vec![u64::MAX - 1; n];
        }
        if let Some(flight) = &mut self.flight {
            flight.step(&batch.states, &batch.scenes, torques)?;
        }
        self.asked.clear();
        for env in 0..n {
            self.tell(batch, env, torques);
            if self.flight.as_mut().is_none_or(|f| f.touches(env, &batch.scenes[env], &self.events)) {
                self.asked.push(env);
            }
        }
        self.network.push(&self.tokens, &self.asked, &mut self.output).map_err(|e| StepError::Solver(e.to_string()))?;
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
        self.network.clear(env);
    }
}
