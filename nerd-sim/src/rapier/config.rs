//! Settings.

use rapier3d_f64::prelude as rapier;
use serde::{Deserialize, Serialize};

use crate::system::MOST_SUBSTEPS;

/// Friction of robots that are one free body; multibodies always have `Coulomb` in rapier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrictionModel {
    /// One friction constraint per contact point.
    Coulomb,
    /// One per four contact points, and a twist constraint: faster, less accurate.
    Simplified,
}

/// Settings of [`super::Rapier`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RapierConfig {
    /// Solver iterations of an outer step, which are rapier's substeps, at least 1. Default 4.
    pub iterations: usize,
    /// Outer steps of a frame, each with its own collision detection and limit check, at least 1. Default 4: with 1, a
    /// link falls through what a frame's travel takes it past (0.1 m penetration on the double pendulum, against 0.01).
    pub steps: usize,
    /// Natural frequency of contacts (Hz). Default 240: at rapier's own 60 a resting robot sinks 0.7 mm, here 0.04 mm.
    pub contact_frequency_hz: f64,
    /// Damping ratio of contacts. Default 10, rapier's.
    pub contact_damping_ratio: f64,
    /// Friction model. Default `coulomb`: the simplified one is up to 10 % off on small feet.
    pub friction: FrictionModel,
    /// Typical length of the scene (m), which scales rapier's tolerances. Default 0.1, the size of a robot's parts.
    pub length_unit: f64,
    /// Restitution of every contact, from 0 to 1. Default 0; it takes the place of the compliant law's damping.
    pub restitution: f64,
}

impl Default for RapierConfig {
    fn default() -> Self {
        Self {
            iterations: 4,
            steps: 4,
            contact_frequency_hz: 240.0,
            contact_damping_ratio: 10.0,
            friction: FrictionModel::Coulomb,
            length_unit: 0.1,
            restitution: 0.0,
        }
    }
}

impl RapierConfig {
    /// `n` substeps in one outer step: for work-precision curves in free space.
    pub fn substeps(n: usize) -> Self {
        Self { iterations: n, steps: 1, ..Self::default() }
    }

    /// Says what is wrong, if anything is.
    pub(super) fn check(&self) -> Result<(), String> {
        if ![self.iterations, self.steps].iter().all(|n| (1..=MOST_SUBSTEPS).contains(n)) {
            let (iterations, steps) = (self.iterations, self.steps);
            return Err(format!("rapier: {iterations} iterations and {steps} steps, 1 to {MOST_SUBSTEPS} of each are needed"));
        }
        for (what, value) in [
            ("contact_frequency_hz", self.contact_frequency_hz),
            ("contact_damping_ratio", self.contact_damping_ratio),
            ("length_unit", self.length_unit),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(format!("rapier: {what} is {value}, a positive number is needed"));
            }
        }
        if !(0.0..=1.0).contains(&self.restitution) {
            return Err(format!("rapier: restitution is {}, a number from 0 to 1 is needed", self.restitution));
        }
        Ok(())
    }

    /// rapier's parameters for frames of `frame_time` (s).
    pub(super) fn parameters(&self, frame_time: f64) -> rapier::IntegrationParameters {
        let softness = rapier::SpringCoefficients::new(self.contact_frequency_hz, self.contact_damping_ratio);
        rapier::IntegrationParameters {
            dt: frame_time / self.steps as f64,
            num_solver_iterations: self.iterations,
            contact_softness: softness,
            static_contact_softness: softness,
            length_unit: self.length_unit,
            friction_model: match self.friction {
                FrictionModel::Coulomb => rapier::FrictionModel::Coulomb,
                FrictionModel::Simplified => rapier::FrictionModel::Simplified,
            },
            // Motion clamping drops time, a speed limit drops energy, a recycled contact is a stale one.
            max_ccd_substeps: 0,
            normalized_max_linear_velocity: f64::MAX,
            contact_recycling: false,
            ..Default::default()
        }
    }
}
