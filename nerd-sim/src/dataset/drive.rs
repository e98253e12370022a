//! What drives random trajectories: fresh random torques every frame, or random actions of a position law with fresh
//! random gains.

use std::sync::Arc;

use rand::{Rng, RngExt};

use crate::control::Controller;
use crate::system::System;

/// Random torques of a system, as in its training data.
pub struct Drive {
    amplitudes: Vec<f64>,
    law: Option<(Controller, crate::spec::RandomGains)>,
    action: Vec<f64>,
}

impl Drive {
    /// The law that the specification describes.
    pub fn new(system: &Arc<System>) -> Self {
        let gains = system.spec.control.and_then(|c| c.data);
        let amplitudes = system.torque_amplitudes();
        Self { action: vec![0.0; amplitudes.len()], amplitudes, law: gains.map(|g| (Controller::new(system), g)) }
    }

    /// Torques of one frame at a state; `scale` is a factor on torques or actions.
    pub fn draw(&mut self, state: &[f64], scale: f64, rng: &mut impl Rng, out: &mut [f64]) {
        let mut side = || 2.0 * rng.random::<f64>() - 1.0;
        let Some((controller, gains)) = &mut self.law else {
            for (tau, a) in out.iter_mut().zip(&self.amplitudes) {
                *tau = if *a == 0.0 { 0.0 } else { scale * a * side() };
            }
            return;
        };
        self.action.iter_mut().for_each(|a| *a = scale * side());
        controller.gains.fill([gains.kp.draw(rng), gains.kd.draw(rng)]);
        controller.torques(state, &self.action, out);
    }
}
