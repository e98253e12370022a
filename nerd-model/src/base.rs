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
}

/// Touch is looked for this far (m) from a surface: its curvature within a frame's travel.
const MARGIN: f64 = 0.01;

/// Flight of many environments at once.
pub struct Flight {
    solver: Articulated,
    batch: Batch,
}

impl Flight {
    /// For a system.
    pub fn new(system: &Arc<System>) -> Self {
        let solver = Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb));
        let batch = Batch::new(system, &Arc::new(Scene::free(system.gravity())), 0);
        Self { solver, batch }
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

    /// States after the last step.
    pub fn states(&self) -> &[f64] {
        &self.batch.states
    }

    /// That of one environment.
    pub fn state(&self, env: usize) -> &[f64] {
        self.batch.state(env)
    }
}

/// Whether contact points may touch something in the frame: if they do where the robot stands (`events`) or where flight takes
/// it (`flown`). `data` and `far` are working memory.
pub(crate) fn may_touch(
    system: &System,
    scene: &Scene,
    events: &[ContactEvent],
    flown: &[f64],
    data: &mut Data,
    far: &mut Vec<ContactEvent>,
) -> bool {
    let near = |events: &[ContactEvent]| events.iter().zip(&system.robot.contact_points).any(|(e, p)| e.distance - p.radius < MARGIN);
    near(events)
        || !scene.colliders.is_empty() && {
            contacts(system, scene, flown, data, far);
            near(far)
        }
}
