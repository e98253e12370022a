//! What drives random trajectories: fresh random torques every frame, or random actions of a position law with fresh
//! random gains.

use std::sync::Arc;

use rand::{Rng, RngExt};

use crate::control::Controller;
use crate::system::{RandomGains, System};

/// How hard a trajectory is driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// Random torques, or random actions of a position law, times this.
    Driven(f64),
    /// Not at all: a position law holds its pose with its own gains.
    Held,
    /// Not at all: a position law lets go, too.
    Limp,
}

impl From<f64> for Effort {
    /// Of a factor on torques: not above 0 is passive, held or, below -1/2, limp.
    fn from(scale: f64) -> Self {
        match scale {
            s if s > 0.0 => Self::Driven(s),
            s if s < -0.5 => Self::Limp,
            _ => Self::Held,
        }
    }
}

/// Random torques of a system, as in its training data.
pub struct Drive {
    amplitudes: Vec<f64>,
    position: Option<Position>,
    action: Vec<f64>,
}

/// A position law whose gains are drawn every frame.
struct Position {
    controller: Controller,
    own: Vec<[f64; 2]>,
    gains: RandomGains,
}

impl Drive {
    /// What the specification describes.
    pub fn new(system: &Arc<System>) -> Self {
        let gains = system.spec.control.and_then(|c| c.data);
        let amplitudes = system.torque_amplitudes();
        Self { action: vec![0.0; amplitudes.len()], amplitudes, position: gains.map(|gains| Position::new(system, gains)) }
    }

    /// Torques of one frame at a state. As many numbers are drawn whatever the effort, but for those of gains.
    pub fn draw(&mut self, state: &[f64], effort: Effort, rng: &mut impl Rng, out: &mut [f64]) {
        let scale = if let Effort::Driven(scale) = effort { scale } else { 0.0 };
        let mut side = || 2.0 * rng.random::<f64>() - 1.0;
        let Some(Position { controller, own, gains }) = &mut self.position else {
            for (tau, a) in out.iter_mut().zip(&self.amplitudes) {
                *tau = if *a == 0.0 { 0.0 } else { scale * a * side() };
            }
            return;
        };
        self.action.iter_mut().for_each(|a| *a = scale * side());
        match effort {
            Effort::Limp => return out.fill(0.0),
            Effort::Held => controller.gains.copy_from_slice(own),
            Effort::Driven(_) => controller.gains.fill([gains.kp.draw(rng), gains.kd.draw(rng)]),
        }
        controller.torques(state, &self.action, out);
    }
}

impl Position {
    fn new(system: &Arc<System>, gains: RandomGains) -> Self {
        let controller = Controller::new(system);
        Self { own: controller.gains.clone(), controller, gains }
    }
}
