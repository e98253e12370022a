//! One frame of a few environments around the network: contacts and tokens before it, predictions to states after it.

use std::sync::Arc;

use nerd_core::contact::ContactEvent;
use nerd_core::dynamics::Data;
use nerd_sim::batch::Batch;
use nerd_sim::scene::contacts;
use nerd_sim::solver::Fault;
use nerd_sim::system::System;

use crate::features::Features;
use crate::folder::Model;

/// Working memory of one thread.
pub(crate) struct Frame {
    features: Features,
    data: Data,
    events: Vec<ContactEvent>,
    change: Vec<f64>,
}

impl Frame {
    /// Memory for a model of `system`.
    pub fn new(model: &Model, system: &Arc<System>) -> Self {
        Self {
            features: Features::new(system, model.config.form()),
            data: Data::new(&system.robot),
            events: Vec::new(),
            change: vec![0.0; system.robot.state_dim()],
        }
    }

    /// Writes the normalised tokens of the environments from `first` on; zeros for those that are set `aside`.
    pub fn tell(&mut self, model: &Model, batch: &Batch, torques: &[f64], aside: &[Fault], first: usize, tokens: &mut [f32]) {
        let (system, joints) = (&batch.system, batch.system.robot.joint_count());
        for (env, token) in (first..).zip(tokens.chunks_exact_mut(model.config.network.inputs)) {
            if aside.iter().any(|fault| fault.env == env) {
                token.fill(0.0);
                continue;
            }
            let (scene, state) = (&batch.scenes[env], batch.state(env));
            self.events.clear();
            if !system.robot.contact_points.is_empty() {
                contacts(&system.robot, scene, state, &mut self.data, &mut self.events);
            }
            self.features.token(state, &self.events, &torques[env * joints..][..joints], &scene.gravity, token);
            model.normalizer.inputs.normalize(token);
        }
    }

    /// Writes the states `next` that lie the predictions from those of the environments from `first` on.
    pub fn apply(&mut self, model: &Model, batch: &Batch, first: usize, predictions: &[f32], next: &mut [f64]) {
        let (d, outputs) = (model.config.network.outputs, &model.normalizer.outputs);
        for (env, (prediction, next)) in (first..).zip(predictions.chunks_exact(d).zip(next.chunks_exact_mut(d))) {
            for (change, (x, (scale, mean))) in self.change.iter_mut().zip(prediction.iter().zip(outputs.scale().zip(&outputs.mean))) {
                *change = f64::from(*x) * scale + mean;
            }
            self.features.apply(batch.state(env), &self.change, next);
        }
    }
}
