//! Settings and presets of articulated dynamics.

use serde::{Deserialize, Serialize};

use crate::prelude::*;
use crate::{range::within, system::MAX_SUBSTEPS};

/// Integrator of frames without contact; explicit steps with contact are always symplectic Euler.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// `qd += qdd dt`, then `q += qd dt`: first order.
    SymplecticEuler,
    /// Classical Runge-Kutta: fourth order.
    Rk4,
}

/// How contact, joint limits and joint damping are integrated over a substep. Robots with dry friction always take
/// implicit steps. A frame with a joint or a friction too stiff for explicit substeps takes implicit steps, too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactStep {
    /// Takes forces at the substep's start, as the reference simulator does; stable only for short substeps.
    #[default]
    Explicit,
    /// Theta method of second order: each force alone is stable at any substep. A frame that gains energy is repeated
    /// with more substeps.
    Implicit,
}

/// Friction law of the compliant contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Friction {
    /// `min(k_f |v_t|, mu N)` against slip: regularised Coulomb (Warp 1.5.1).
    Coulomb,
    /// `min(k_f s, mu N) |v_t| / s` with the Huber size s of the slip (Warp 1.8).
    Huber,
}

pub(super) struct Settings {
    pub(super) config: ArticulatedConfig,
    /// Tolerance on the relative change of a drag between two solves, in a frame of one substep. Second: the most
    /// solves of a substep. See `kick.rs`.
    pub(super) settling: (f64, usize),
}

/// Inputs of a frame. `contact`: whether there are colliders and contact points. `tau`: torques `[joint]` (N m or N).
#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub(super) system: &'a System,
    pub(super) scene: &'a Scene,
    pub(super) config: ArticulatedConfig,
    pub(super) contact: bool,
    pub(super) tau: &'a [f64],
}

/// Settings of [`super::Articulated`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArticulatedConfig {
    /// Integrator of frames without contact, dry friction, springs, drives and self-collision.
    pub integrator: Integrator,
    /// Substeps per frame, at least 1, of the frames that `integrator` steps.
    ///
    /// A frame uses either `substeps` or `contact_substeps`. A frame repeated implicitly for a stiff joint uses the
    /// larger of the two. A sweep over one setting does not change frames that use the other. [`Self::moves_as`] tells
    /// whether two configurations give the same motion.
    pub substeps: usize,
    /// Substeps per frame, at least 1, of frames with contact, dry friction, springs, drives or self-collision.
    pub contact_substeps: usize,
    /// When the mass matrix is recomputed (symplectic Euler only).
    pub refresh: Refresh,
    /// How contact is integrated over a substep.
    #[serde(default)]
    pub contact_step: ContactStep,
    /// Friction law.
    pub friction: Friction,
}

impl ArticulatedConfig {
    /// Reference simulator: symplectic Euler with the specification's substeps and refresh of the mass matrix.
    pub fn paper(system: &System, friction: Friction) -> Self {
        Self { refresh: system.spec.refresh, ..Self::explicit(system.spec.substeps, friction) }
    }

    /// Symplectic Euler with the mass matrix recomputed at every substep, with contact or without.
    pub fn explicit(substeps: usize, friction: Friction) -> Self {
        Self {
            integrator: Integrator::SymplecticEuler,
            substeps,
            contact_substeps: substeps,
            refresh: Refresh::Substep,
            contact_step: ContactStep::Explicit,
            friction,
        }
    }

    /// Theta method for contact, limits and joint damping: of second order, and stable with few substeps. `substeps`
    /// sets `contact_substeps`. Frames in free space always take four substeps of RK4.
    pub fn implicit(substeps: usize, friction: Friction) -> Self {
        let integrator = Integrator::Rk4;
        let contact_step = ContactStep::Implicit;
        Self { integrator, substeps: 4, contact_step, ..Self::explicit(substeps, friction) }
    }

    /// Ground truth for models, policies and charts: [`Self::implicit`] with the substeps of the robot's specification.
    /// `results/substeps.md` at commit `5ced4b7` measures the change when the substeps are doubled.
    pub fn accurate(system: &System) -> Self {
        Self::implicit(system.spec.substeps, Friction::Coulomb)
    }

    /// Most accurate preset: RK4 with four substeps in free space, [`Self::implicit`] with 128 substeps elsewhere.
    ///
    /// Four RK4 substeps suffice while no joint turns by more than about 0.1 rad in a substep. A light wrist with
    /// aligned axes, without damping or armature, turns far faster and needs 64 to 256 substeps
    /// (`nerd-sim/tests/articulated/convergence.rs`).
    pub fn converged(friction: Friction) -> Self {
        Self::implicit(128, friction)
    }

    /// Whether two settings give the same motion. With `contact` (or dry friction) the implicit step depends on
    /// `contact_substeps` and `friction` alone.
    pub fn moves_as(&self, other: &Self, contact: bool) -> bool {
        let implicit =
            |c: &Self| (contact && c.contact_step == ContactStep::Implicit).then_some((c.contact_substeps, c.friction));
        self == other || implicit(self).is_some() && implicit(self) == implicit(other)
    }

    /// Refuses numbers of substeps outside 1 to `MAX_SUBSTEPS`.
    pub fn check(&self) -> Result<(), String> {
        for (key, n) in [("substeps", self.substeps), ("contact_substeps", self.contact_substeps)] {
            within(format_args!("articulated: {key}"), n as f64, 1.0..=MAX_SUBSTEPS as f64, "")?;
        }
        Ok(())
    }
}
