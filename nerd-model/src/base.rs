//! What a prediction is added to: the present state, as in the paper, or the state after a frame of flight.
//!
//! Flight is one frame of our articulated dynamics, joint limits and damping included, at the reference simulator's settings,
//! in a scene with nothing in it. It costs microseconds. Then the network is left with what contact does, and an environment
//! where nothing can be touched within the frame needs no network.

use std::sync::Arc;

use nerd_core::contact::ContactEvent;
use nerd_core::dynamics::Data;
use nerd_sim::articulated::{Articulated, ArticulatedConfig, Friction};
use nerd_sim::batch::{Batch, contacts};
use nerd_sim::scene::Scene;
use nerd_sim::solver::{Solver, StepError};
use nerd_sim::system::System;
use serde::{Deserialize, Serialize};

/// What a prediction is added to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Base {
    /// The state before the frame: the paper's form.
    #[default]
    State,
    /// The state after a frame of flight: the residual form.
    Flight,
    /// Nothing: the prediction is the next state itself, endless angles continued from the token's (paper A.3.3.3, to be
    /// compared with).
    Nothing,
}

/// Touch is looked for this far (m) from a surface: its curvature within a frame's travel.
const MARGIN: f64 = 0.01;

/// Flight of many environments at once.
pub struct Flight {
    solver: Articulated,
    batch: Batch,
    data: Data,
    events: Vec<ContactEvent>,
}

impl Flight {
    /// For a system.
    pub fn new(system: &Arc<System>) -> Self {
        let solver = Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb));
        let batch = Batch::new(system, &Arc::new(Scene::free(system.gravity())), 0);
        Self { solver, batch, data: Data::new(&system.robot), events: Vec::new() }
    }

    /// States `[env][q, qd]` a frame after `states`, with torques `[env][joint]`.
    pub fn step(&mut self, states: &[f64], scenes: &[Arc<Scene>], torques: &[f64]) -> Result<&[f64], StepError> {
        let batch = &mut self.batch;
        let n = scenes.len();
        // Of a scene only its gravity is felt in flight.
        for (env, scene) in scenes.iter().enumerate() {
            match batch.scenes.get_mut(env) {
                Some(free) if free.gravity == scene.gravity => {}
                Some(free) => *free = Arc::new(Scene::free(scene.gravity)),
                None => batch.scenes.push(Arc::new(Scene::free(scene.gravity))),
            }
        }
        batch.scenes.truncate(n);
        batch.frames.resize(n, 0);
        batch.states.clear();
        batch.states.extend_from_slice(states);
        self.solver.step(batch, torques)?;
        Ok(&batch.states)
    }

    /// State of one environment after the last step.
    pub fn state(&self, env: usize) -> &[f64] {
        self.batch.state(env)
    }

    /// Whether environment `env` may touch something in the frame: if it does where it stands (`events`) or where flight
    /// takes it.
    pub fn touches(&mut self, env: usize, scene: &Scene, events: &[ContactEvent]) -> bool {
        let system = self.batch.system.clone();
        let near = |events: &[ContactEvent]| events.iter().zip(&system.robot.contact_points).any(|(e, p)| e.distance - p.radius < MARGIN);
        if near(events) {
            return true;
        }
        if scene.colliders.is_empty() {
            return false;
        }
        contacts(&system, scene, self.batch.state(env), &mut self.data, &mut self.events);
        near(&self.events)
    }
}
