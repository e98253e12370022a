//! What drives random trajectories: fresh random torques every frame, or random actions of a position law with fresh
//! random gains.

use std::sync::Arc;

use rand::{Rng, RngExt};

use crate::control::Controller;
use crate::spec::RandomGains;
use crate::system::System;

/// Random torques of a system, as in its training data.
pub struct Drive {
    amplitudes: Vec<f64>,
    law: Option<Range>,
    action: Vec<f64>,
}

/// A position law whose gains are drawn anew every frame.
struct Range {
    controller: Controller,
    own: Vec<[f64; 2]>,
    gains: RandomGains,
}

impl Drive {
    /// The law that the specification describes.
    pub fn new(system: &Arc<System>) -> Self {
        let gains = system.spec.control.and_then(|c| c.data);
        let amplitudes = system.torque_amplitudes();
        Self { action: vec![0.0; amplitudes.len()], amplitudes, law: gains.map(|gains| Range::new(system, gains)) }
    }

    /// Torques of one frame at a state; `scale` is a factor on torques or actions. Not above 0, the robot is passive: a position
    /// law holds its pose with its own gains, or below -1/2 lets go.
    pub fn draw(&mut self, state: &[f64], scale: f64, rng: &mut impl Rng, out: &mut [f64]) {
        let mut side = || 2.0 * rng.random::<f64>() - 1.0;
        let Some(Range { controller, own, gains }) = &mut self.law else {
            for (tau, a) in out.iter_mut().zip(&self.amplitudes) {
                *tau = if *a == 0.0 { 0.0 } else { scale.max(0.0) * a * side() };
            }
            return;
        };
        self.action.iter_mut().for_each(|a| *a = scale.max(0.0) * side());
        if scale < -0.5 {
            return out.fill(0.0);
        }
        if scale <= 0.0 {
            controller.gains.copy_from_slice(own);
        } else {
            controller.gains.fill([gains.kp.draw(rng), gains.kd.draw(rng)]);
        }
        controller.torques(state, &self.action, out);
    }
}

impl Range {
    fn new(system: &Arc<System>, gains: RandomGains) -> Self {
        let controller = Controller::new(system);
        Self { own: controller.gains.clone(), controller, gains }
    }
}
