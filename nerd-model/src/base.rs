//! What a prediction is added to: the present state, as in the paper, or the state after a frame of flight.
//!
//! Flight is one frame of our articulated dynamics, joint limits and damping included, in an empty scene, integrated as the truth does:
//! with the reference simulator's settings for the truth `paper`, exactly for every other (rapier's own error over a frame is then the
//! floor of a model of it). It costs microseconds. The network is left with contact, and an environment where nothing can be touched
//! within the frame needs no network.

use std::sync::Arc;

use nerd_sim::articulated::{Articulated, ArticulatedConfig, Friction};
use nerd_sim::batch::Batch;
use nerd_sim::scene::Scene;
use nerd_sim::solver::{Solver, StepError};
use nerd_sim::system::System;
use nerd_sim::truth::Truth;
use serde::{Deserialize, Serialize};

/// What a prediction is added to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Base {
    /// The state before the frame: the paper's form.
    #[default]
    State,
    /// The state; positions count from where the mean of the velocities before and after would go ([`crate::trapezoid`]).
    Trapezoid,
    /// The state after a frame of flight at the reference simulator's settings: the residual form.
    Flight,
    /// The state after a frame of flight by Runge-Kutta: the residual form for every other truth.
    ExactFlight,
    /// Nothing: the prediction is the next state itself, endless angles continued from the token's (paper A.3.3.3, to be
    /// compared with).
    Nothing,
}

impl Base {
    /// The flight nearest to a truth's own, what the residual form adds to.
    pub fn flight_of(truth: Truth) -> Self {
        if truth == Truth::Paper { Self::Flight } else { Self::ExactFlight }
    }

    /// Whether predictions are added to a frame of flight.
    pub fn flies(self) -> bool {
        matches!(self, Self::Flight | Self::ExactFlight)
    }

    /// The flight that predictions are added to, if any.
    pub fn flight(self, system: &Arc<System>) -> Option<Flight> {
        let config = match self {
            Self::State | Self::Trapezoid | Self::Nothing => return None,
            Self::Flight => ArticulatedConfig::paper(system, Friction::Coulomb),
            Self::ExactFlight => ArticulatedConfig::converged(Friction::Coulomb),
        };
        Some(Flight::new(system, config))
    }
}

/// Flight of many environments at once.
pub struct Flight {
    solver: Articulated,
    batch: Batch,
}

impl Flight {
    fn new(system: &Arc<System>, config: ArticulatedConfig) -> Self {
        Self { solver: Articulated::new(config), batch: Batch::new(system, &Arc::new(Scene::free(system.gravity())), 0) }
    }

    /// States `[env][q, qd]` a frame after `states`, with torques `[env][joint]`.
    pub fn step(&mut self, states: &[f64], scenes: &[Arc<Scene>], torques: &[f64]) -> Result<&[f64], StepError> {
        let (batch, n) = (&mut self.batch, scenes.len());
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
}
