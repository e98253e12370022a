//! Settings and presets.

use serde::{Deserialize, Serialize};

use crate::prelude::*;
use crate::{range::within, system::MOST_SUBSTEPS};

/// Integrator of contact-free environments; those with contact use symplectic Euler.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// `qd += qdd dt`, then `q += qd dt`: first order.
    SymplecticEuler,
    /// Classical Runge-Kutta: fourth order.
    Rk4,
}

/// How contact, limits and joint damping act within a substep. A robot with dry friction is stepped implicitly in any case, and a
/// frame that meets a joint or a friction too stiff for an explicit substep, too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactStep {
    /// With their forces at its start, as in the reference: stable only while the substep is short.
    #[default]
    Explicit,
    /// With forces that look as far ahead as they must, each by itself stable at any length, and of second order. A frame that gives energy is
    /// stepped again, finer.
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
    /// Change of a drag, relative, that asks for no other solve of a frame's one substep, and solves at most: see `kick.rs`.
    pub(super) settling: (f64, usize),
}

/// What a frame is asked: `contact` is whether something can touch something.
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
    /// Integrator where there is nothing to touch, and no dry friction.
    pub integrator: Integrator,
    /// Substeps a frame in free space, at least 1: of a robot without dry friction, springs and drives, where there is nothing to touch.
    ///
    /// It and `contact_substeps` never act in one frame, except that a frame in which a joint turns out too stiff takes the larger of the two.
    /// So a sweep over one of them alone changes nothing where the other acts; [`Self::moves_as`] tells whether two settings differ.
    pub substeps: usize,
    /// Substeps a frame everywhere else, at least 1.
    pub contact_substeps: usize,
    /// When the mass matrix is renewed (symplectic Euler only).
    pub refresh: Refresh,
    /// How contact acts within a substep.
    #[serde(default)]
    pub contact_step: ContactStep,
    /// Friction law.
    pub friction: Friction,
}

impl ArticulatedConfig {
    /// The reference simulator: symplectic Euler at its substeps, mass matrix renewed when it does.
    pub fn paper(system: &System, friction: Friction) -> Self {
        Self { refresh: system.spec.refresh, ..Self::explicit(system.spec.substeps, friction) }
    }

    /// Symplectic Euler with the mass matrix renewed at every substep, with contact or without.
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

    /// Stable at few substeps, and of second order: contact, limits and joint damping look ahead. `substeps` are those of contact: in free
    /// space it is RK4 with four, whatever they are.
    pub fn implicit(substeps: usize, friction: Friction) -> Self {
        let (integrator, contact_step) = (Integrator::Rk4, ContactStep::Implicit);
        Self { integrator, substeps: 4, contact_step, ..Self::explicit(substeps, friction) }
    }

    /// The truth of models, policies and charts: [`Self::implicit`] with the substeps of the robot's specification.
    /// What twice as many change is measured (`results/substeps.md` at commit `5ced4b7`).
    pub fn accurate(system: &System) -> Self {
        Self::implicit(system.spec.substeps, Friction::Coulomb)
    }

    /// As accurate as can be: RK4 with four substeps in free space, [`Self::implicit`] with 128 where there is something to touch.
    ///
    /// Four are enough while no joint turns by more than some 0.1 rad in a substep. A light wrist without damping or armature whose
    /// axes line up spins far faster and wants 64 to 256 (`nerd-sim/tests/articulated/convergence.rs`).
    pub fn converged(friction: Friction) -> Self {
        Self::implicit(128, friction)
    }

    /// Whether both move a robot alike: where there is something to touch, or dry friction (`contact`), the implicit step knows no
    /// more than its own substeps.
    pub fn moves_as(&self, other: &Self, contact: bool) -> bool {
        let implicit = |c: &Self| (contact && c.contact_step == ContactStep::Implicit).then_some((c.contact_substeps, c.friction));
        self == other || implicit(self).is_some() && implicit(self) == implicit(other)
    }

    /// Refuses numbers of substeps that would do nothing, or never end.
    pub fn check(&self) -> Result<(), String> {
        for (key, n) in [("substeps", self.substeps), ("contact_substeps", self.contact_substeps)] {
            within(format_args!("articulated: {key}"), n as f64, 1.0..=MOST_SUBSTEPS as f64, "")?;
        }
        Ok(())
    }
}
