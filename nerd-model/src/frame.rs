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

/// Touch is looked for this far (m) from a surface: its curvature within a frame's travel.
const MARGIN: f64 = 0.01;

/// Working memory of one thread.
pub(crate) struct Frame {
    features: Features,
    data: Data,
    events: Vec<ContactEvent>,
    far: Vec<ContactEvent>,
    change: Vec<f64>,
    base: Vec<f64>,
    /// Environments of the frame that need the network.
    pub asked: Vec<usize>,
}

impl Frame {
    /// Memory for a model of `system`.
    pub fn new(model: &Model, system: &Arc<System>) -> Self {
        let d = system.robot.state_dim();
        Self {
            features: Features::new(system, model.config.form()),
            data: Data::new(&system.robot),
            events: Vec::new(),
            far: Vec::new(),
            change: vec![0.0; d],
            base: vec![0.0; d],
            asked: Vec::new(),
        }
    }

    /// Writes the normalised tokens of the environments from `first` on but for those that are set `aside`, and notes which of
    /// them need the network. `next` are the bases of their predictions.
    #[allow(clippy::too_many_arguments)]
    pub fn tell(&mut self, model: &Model, batch: &Batch, torques: &[f64], aside: &[Fault], first: usize, tokens: &mut [f32], next: &[f64]) {
        self.asked.clear();
        let (system, flies) = (&batch.system, model.config.base.flies());
        let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
        for (i, token) in tokens.chunks_exact_mut(model.config.network.inputs).enumerate() {
            let env = first + i;
            if aside.iter().any(|fault| fault.env == env) {
                token.fill(0.0);
                continue;
            }
            let (scene, state) = (&batch.scenes[env], batch.state(env));
            self.events.clear();
            if !system.robot.contact_points.is_empty() {
                contacts(&system.robot, scene, state, &mut self.data, &mut self.events);
            }
            let base = &next[i * d..(i + 1) * d];
            let tau = &torques[env * joints..(env + 1) * joints];
            self.features.token(state, base, &self.events, tau, &scene.gravity, token);
            model.normalizer.inputs.normalize(token);
            // On a flight, where something may be touched: at its start or at its end.
            let points = &system.robot.contact_points;
            let near = |events: &[ContactEvent]| events.iter().zip(points).any(|(e, p)| e.distance - p.radius < MARGIN);
            let mut lands = || {
                contacts(&system.robot, scene, base, &mut self.data, &mut self.far);
                near(&self.far)
            };
            if !flies || near(&self.events) || !scene.colliders.is_empty() && lands() {
                self.asked.push(env);
            }
        }
    }

    /// Moves the states `next` of the environments from `first` on, at first the bases of their predictions, by the
    /// predictions `[asked][outputs]` of those that were asked.
    pub fn apply(&mut self, model: &Model, batch: &Batch, first: usize, predictions: &[f32], next: &mut [f64]) {
        let d = model.config.network.outputs;
        let outputs = &model.normalizer.outputs;
        for (env, prediction) in self.asked.iter().zip(predictions.chunks_exact(d)) {
            for (change, (x, (scale, mean))) in self.change.iter_mut().zip(prediction.iter().zip(outputs.scale().zip(&outputs.mean))) {
                *change = f64::from(*x) * scale + mean;
            }
            let next = &mut next[(env - first) * d..(env - first + 1) * d];
            self.base.copy_from_slice(next);
            self.features.apply(batch.state(*env), &self.base, &self.change, next);
        }
    }
}
