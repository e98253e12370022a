//! What a frame keeps of its substeps for the way back.

use nerd_core::dynamics::Factor;

use super::{touch::Touch, touches::Touches};
use crate::prelude::*;

#[derive(Default)]
pub(super) struct Kept {
    pub(super) steps: Vec<Step>,
    /// Those of the substep that is solved now.
    pub(super) stages: Vec<Stage>,
    /// Stages of Runge-Kutta's substeps, four of each. There may be more, which wait for longer frames.
    flown: Vec<Flown>,
    flights: usize,
}

/// A stage of Runge-Kutta, with what was found on the way to its rate.
pub(super) struct Flown {
    /// `[q, qd]` in local velocities, and their rates.
    pub(super) state: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) data: Data,
    pub(super) factor: Factor,
}

pub(super) struct Step {
    pub(super) h: f64,
    /// Coordinates in its middle, and local velocities at its start.
    pub(super) q: Vec<f64>,
    pub(super) qd: Vec<f64>,
    pub(super) touches: Vec<Touch>,
    /// Of the joints, see [`Touches`].
    pub(super) braked: Vec<f64>,
    pub(super) shares: Vec<f64>,
    /// Each with the rate of the one before for its middle.
    pub(super) stages: Vec<Stage>,
    /// Whether it was too long, and two halves of it went on from where it began, with its rate for the first one's middle.
    pub(super) lost: bool,
}

/// Solves of a substep with one velocity in its middle.
pub(super) struct Stage {
    pub(super) middle: Vec<f64>,
    /// Change of local velocities over time.
    pub(super) rate: Vec<f64>,
    /// Which touches do nothing, or what does not change: contacts that have parted, drives at a bound.
    pub(super) idle: Vec<bool>,
    /// Whether drags are those that the substep began with: it was one solve.
    pub(super) first: bool,
    /// Whether the spin of the middle is that of its own rate (`spin.rs`).
    pub(super) spun: bool,
}

impl Kept {
    pub(super) fn begin(&mut self) {
        self.steps.clear();
        self.stages.clear();
        self.flights = 0;
    }

    /// Takes over what was found, and leaves other memory for what is found next.
    pub(super) fn flown(&mut self, state: &[f64], rate: &[f64], data: &mut Data, factor: &mut Factor) {
        if self.flights == self.flown.len() {
            let [state, rate] = [state, rate].map(<[f64]>::to_vec);
            self.flown.push(Flown { state, rate, data: data.clone(), factor: factor.clone() });
        } else {
            let stage = &mut self.flown[self.flights];
            stage.state.copy_from_slice(state);
            stage.rate.copy_from_slice(rate);
            std::mem::swap(&mut stage.data, data);
            std::mem::swap(&mut stage.factor, factor);
        }
        self.flights += 1;
    }

    pub(super) fn flights(&self) -> &[Flown] {
        &self.flown[..self.flights]
    }

    pub(super) fn stage(&mut self, now: &Touches, one_solve: bool, spun: bool) {
        let first = one_solve && self.stages.is_empty();
        let idle = |touch: &Touch| match touch {
            Touch::Contact(contact) => contact.parted,
            Touch::Drive { held, .. } => held.is_some(),
            Touch::Friction(_) | Touch::Limit(_) => false,
        };
        let idle = now.touches.iter().map(|touch| !first && idle(touch)).collect();
        self.stages.push(Stage { middle: now.middle.clone(), rate: now.rate.clone(), idle, first, spun });
    }

    pub(super) fn step(&mut self, h: f64, q: &[f64], qd: &[f64], now: &Touches, lost: bool) {
        self.steps.push(Step {
            h,
            q: q.to_vec(),
            qd: qd.to_vec(),
            touches: now.touches.clone(),
            braked: now.braked.clone(),
            shares: now.shares.clone(),
            stages: std::mem::take(&mut self.stages),
            lost,
        });
    }
}
