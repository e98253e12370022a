//! Computes one frame of a chunk of environments around the network: contacts and tokens, next states from predictions,
//! and the adjoint.

use nerd_core::state::wrap_state;
use nerd_sim::solver::{Fault, Gradients};

use crate::prelude::*;
use crate::program::cpu::{Loaded, Memory, Pass};
use crate::{around::Around, features::Features};

pub(crate) struct Frame {
    around: Around,
    features: Features,
    data: Data,
    events: Vec<ContactEvent>,
    change: Vec<f64>,
    memory: Memory,
}

impl Frame {
    pub fn new(model: &Model, system: &Arc<System>) -> Self {
        let form = model.config.form();
        Self {
            around: Around { system: system.clone(), form, normalizer: model.normalizer.clone() },
            features: Features::new(system, form),
            data: Data::new(&system.robot),
            events: Vec::new(),
            change: vec![0.0; system.robot.state_dim()],
            memory: Memory::default(),
        }
    }

    /// Writes the normalised tokens `[env][inputs]` of the environments from `first` on. Tokens of failed environments,
    /// listed in `aside`, are zero.
    pub fn tell(&mut self, batch: &Batch, torques: &[f64], aside: &[Fault], first: usize, tokens: &mut [f32]) {
        for (env, token) in (first..).zip(tokens.chunks_exact_mut(self.around.normalizer.inputs.mean.len())) {
            if aside.iter().any(|fault| fault.env == env) {
                token.fill(0.0);
            } else {
                self.look(batch, torques, env, token);
            }
        }
    }

    /// Finds the contacts of an environment and writes its normalised token.
    fn look(&mut self, batch: &Batch, torques: &[f64], env: usize, token: &mut [f32]) {
        let robot = &batch.system.robot;
        let scene = &batch.scenes[env];
        let state = batch.state(env);
        let joints = robot.joint_count();
        self.events.clear();
        if !robot.contact_points.is_empty() {
            contacts(&batch.system, scene, state, &mut self.data, &mut self.events);
        }
        self.features.tell(&batch.of(env).drawn);
        self.features.token(state, &self.events, &torques[env * joints..][..joints], &scene.gravity, token);
        self.around.normalizer.inputs.normalize(token);
    }

    /// Applies predictions to the states of the environments from `first` on. Writes the next states to `next`,
    /// `[env][q, qd]`.
    pub fn apply(&mut self, batch: &Batch, first: usize, predictions: &[f32], next: &mut [f64]) {
        let d = self.change.len();
        for (env, (prediction, next)) in (first..).zip(predictions.chunks_exact(d).zip(next.chunks_exact_mut(d))) {
            self.change.iter_mut().zip(self.around.change(prediction)).for_each(|(change, x)| *change = x);
            self.features.apply(batch.state(env), &self.change, next);
        }
    }

    /// Gradients of a frame of `count` environments from `first` on, through a one-token `network`. `grad_next` is
    /// `[env][rows][2 nv]`, over all environments.
    pub fn back(
        &mut self,
        (batch, torques): (&Batch, &[f64]),
        network: &Loaded,
        (first, count): (usize, usize),
        (rows, grad_next): (usize, &[f64]),
    ) -> Gradients {
        let robot = &batch.system.robot;
        let joints = robot.joint_count();
        let wide = 2 * robot.nv();
        let d = robot.state_dim();
        let inputs = self.around.normalizer.inputs.mean.len();
        let mut tokens = vec![0.0; count * inputs];
        let mut seen = Vec::with_capacity(count);
        for (env, token) in (first..).zip(tokens.chunks_exact_mut(inputs)) {
            self.look(batch, torques, env, token);
            seen.push(self.events.clone());
        }
        let outputs = network.forward(&tokens, &mut self.memory, Pass::Kept(1)).clone();
        let mut found =
            Gradients { next: vec![0.0; count * d], states: vec![0.0; count * rows * wide], ..Gradients::default() };
        self.apply(batch, first, &outputs, &mut found.next);
        found.next.chunks_exact_mut(d).for_each(|next| wrap_state(robot, next));
        found.torques.resize(count * rows * joints, 0.0);
        for row in 0..rows {
            let at = |i: usize| (i * rows + row) * wide..(i * rows + row + 1) * wide;
            let grad_next = &grad_next[first * rows * wide..];
            let by_outputs = (0..count).zip(outputs.chunks_exact(d)).flat_map(|(i, outputs)| {
                self.around.outputs_back(batch.state(first + i), outputs, &grad_next[at(i)], &mut found.states[at(i)])
            });
            let by_outputs: Vec<f32> = by_outputs.collect();
            let by_tokens = network.backward_to_tokens(1, &by_outputs, &mut self.memory);
            for (i, (by, contacts)) in by_tokens.chunks_exact(inputs).zip(&seen).enumerate() {
                let env = first + i;
                let gradient = &mut found.states[at(i)];
                let by = self.around.token_back(
                    batch.state(env),
                    (contacts, batch.scenes[env].gravity),
                    by,
                    &mut self.data,
                    gradient,
                );
                found.torques[(i * rows + row) * joints..][..joints].copy_from_slice(self.around.of_torques(&by));
            }
        }
        found
    }
}
