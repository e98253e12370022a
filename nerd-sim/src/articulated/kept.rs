//! Record of a frame's substeps for the backward pass.

use nerd_core::dynamics::Factor;

use super::{touch::Touch, touches::Touches};
use crate::prelude::*;

#[derive(Default)]
pub(super) struct Kept {
    pub(super) steps: Vec<Step>,
    /// Stages of the substep being solved.
    pub(super) stages: Vec<Stage>,
    /// Stages of Runge-Kutta's substeps, four each. Entries beyond `flights` are spare memory for longer frames.
    flown: Vec<Flown>,
    flights: usize,
}

/// A stage of Runge-Kutta, with the kinematics and the mass matrix's factor behind its rate.
pub(super) struct Flown {
    /// `[q, qd]` in local velocities, and its time derivative.
    pub(super) state: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) data: Data,
    pub(super) factor: Factor,
}

pub(super) struct Step {
    pub(super) h: f64,
    /// Coordinates at the substep's middle, and local velocities at its start.
    pub(super) q: Vec<f64>,
    pub(super) qd: Vec<f64>,
    pub(super) touches: Vec<Touch>,
    /// Damping and implicit resistance of the joints, see [`Touches`].
    pub(super) damping_used: Vec<f64>,
    pub(super) shares: Vec<f64>,
    /// Stages of the substep: the middle velocity of each uses the rate of the stage before.
    pub(super) stages: Vec<Stage>,
    /// Whether the substep was too long, so that two halves replaced it. The lost substep's rate then predicts the
    /// middle velocity of the first half.
    pub(super) lost: bool,
}

/// Consecutive solves of a substep with the same middle velocity; the record is that of the last solve.
pub(super) struct Stage {
    pub(super) middle: Vec<f64>,
    /// Rate of change of local velocities.
    pub(super) rate: Vec<f64>,
    /// By touch: whether its force is zero or constant, as of parted contacts and saturated drives.
    pub(super) idle: Vec<bool>,
    /// By touch: slip and angular velocity offsets of sticking contacts (m/s, `Contact::slip_offset`; rad/s,
    /// `Turning::turn_offset`).
    pub(super) held: Vec<[Vector3<f64>; 2]>,
    /// Whether `held` comes from the stage before, in the same substep.
    pub(super) again: bool,
    /// Whether drags are still the initial ones of the substep, because the stage was one solve.
    pub(super) first: bool,
    /// Whether the middle angular velocity is the mean of the substep's start and its end under this stage's rate
    /// (`spin.rs`).
    pub(super) spun: bool,
}

impl Kept {
    pub(super) fn begin(&mut self) {
        self.steps.clear();
        self.stages.clear();
        self.flights = 0;
    }

    /// Records a stage of Runge-Kutta. Exchanges `data` and `factor` for spare memory, where there is some.
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
        let held = |touch: &Touch| match touch {
            Touch::Contact(contact) => [contact.slip_offset, contact.turning.turn_offset],
            _ => [Vector3::zeros(); 2],
        };
        let held = now.touches.iter().map(held).collect();
        self.stages.push(Stage {
            middle: now.middle.clone(),
            rate: now.rate.clone(),
            idle,
            held,
            again: !self.stages.is_empty(),
            first,
            spun,
        });
    }

    pub(super) fn step(&mut self, h: f64, q: &[f64], qd: &[f64], now: &Touches, lost: bool) {
        let stages = std::mem::take(&mut self.stages);
        self.steps.push(Step {
            h,
            q: q.to_vec(),
            qd: qd.to_vec(),
            touches: now.touches.clone(),
            damping_used: now.damping_used.clone(),
            shares: now.shares.clone(),
            stages,
            lost,
        });
    }
}
