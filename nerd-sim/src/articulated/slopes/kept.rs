//! What a frame keeps of its substeps for the way back.

use super::super::touch::Touch;
use super::super::touches::Touches;

/// Of a frame.
#[derive(Default)]
pub(in super::super) struct Kept {
    /// Implicit substeps.
    pub(super) steps: Vec<Step>,
    /// Those of the substep that is solved now.
    pub(in super::super) stages: Vec<Stage>,
    /// States before explicit substeps, each `[q, qd]` in local velocities.
    pub(in super::super) states: Vec<Vec<f64>>,
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
}

/// Solves of a substep with one velocity in its middle.
pub(in super::super) struct Stage {
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
    pub(in super::super) fn begin(&mut self) {
        self.steps.clear();
        self.stages.clear();
        self.states.clear();
    }

    pub(in super::super) fn stage(&mut self, now: &Touches, one_solve: bool) {
        let first = one_solve && self.stages.is_empty();
        let idle = |touch: &Touch| match touch {
            Touch::Contact(contact) => contact.parted,
            Touch::Drive { held, .. } => held.is_some(),
            Touch::Friction(_) | Touch::Limit(_) => false,
        };
        let idle = now.touches.iter().map(|touch| !first && idle(touch)).collect();
        self.stages.push(Stage { middle: now.middle.clone(), rate: now.rate.clone(), idle, first });
    }

    pub(in super::super) fn step(&mut self, h: f64, q: &[f64], qd: &[f64], now: &Touches) {
        self.steps.push(Step {
            h,
            q: q.to_vec(),
            qd: qd.to_vec(),
            touches: now.touches.clone(),
            braked: now.braked.clone(),
            shares: now.shares.clone(),
            stages: std::mem::take(&mut self.stages),
        });
    }
}
