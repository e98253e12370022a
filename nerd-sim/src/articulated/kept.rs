//! What a frame keeps of its substeps for the way back.

use super::touch::Touch;
use super::touches::Touches;

/// Of a frame.
#[derive(Default)]
pub(super) struct Kept {
    /// Implicit substeps.
    pub(super) steps: Vec<Step>,
    /// Those of the substep that is solved now.
    pub(super) stages: Vec<Stage>,
    /// Of Runge-Kutta's substeps, each the state `[q, qd]` before it, in local velocities, and the four rates.
    pub(super) states: Vec<f64>,
}

/// An implicit substep.
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
}

impl Kept {
    /// A frame begins, or begins again.
    pub(super) fn begin(&mut self) {
        self.steps.clear();
        self.stages.clear();
        self.states.clear();
    }

    pub(super) fn stage(&mut self, now: &Touches, one_solve: bool) {
        let first = one_solve && self.stages.is_empty();
        let idle = |touch: &Touch| match touch {
            Touch::Contact(contact) => contact.parted,
            Touch::Drive { held, .. } => held.is_some(),
            Touch::Friction(_) | Touch::Limit(_) => false,
        };
        let idle = now.touches.iter().map(|touch| !first && idle(touch)).collect();
        self.stages.push(Stage { middle: now.middle.clone(), rate: now.rate.clone(), idle, first });
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
