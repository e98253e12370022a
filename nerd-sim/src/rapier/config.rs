//! Settings.

use rapier3d_f64::prelude as rapier;

use crate::{internal::*, system::MOST_SUBSTEPS};

/// Natural frequency of contacts (Hz): at rapier's own 60 a resting robot sinks 0.7 mm, here 0.04 mm. Their damping ratio is rapier's own.
const FREQUENCY: f64 = 240.0;
const DAMPING_RATIO: f64 = 10.0;
/// Typical length of the scene (m), which scales rapier's tolerances: the size of a robot's parts.
const LENGTH: f64 = 0.1;

/// Settings of [`super::Rapier`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RapierConfig {
    /// Solver iterations of an outer step, which are rapier's substeps, at least 1. Default 4.
    pub iterations: usize,
    /// Outer steps of a frame, each with its own collision detection and limit check, at least 1. Default 4: with 1, a link passes through
    /// a surface that it crosses within a frame (0.1 m penetration on the double pendulum, against 0.01).
    pub steps: usize,
    /// Restitution of every contact, from 0 to 1. Default 0; it replaces the compliant law's damping.
    pub restitution: f64,
    /// Whether a floating robot's frame is stepped in the axes of its root at the frame's start. Default no. rapier's friction acts along
    /// two axes of its world, so a rotated robot slides differently: on the Ant by more than half of the steps would change.
    pub own_axes: bool,
}

impl Default for RapierConfig {
    fn default() -> Self {
        Self { iterations: 4, steps: 4, restitution: 0.0, own_axes: false }
    }
}

impl RapierConfig {
    /// `n` substeps in one outer step: for work-precision curves in free space.
    pub fn substeps(n: usize) -> Self {
        Self { iterations: n, steps: 1, ..Self::default() }
    }

    pub(super) fn check(&self) -> Result<(), String> {
        within("rapier: iterations", self.iterations as f64, 1.0..=MOST_SUBSTEPS as f64, "")?;
        within("rapier: steps", self.steps as f64, 1.0..=MOST_SUBSTEPS as f64, "")?;
        within("rapier: restitution", self.restitution, 0.0..=1.0, "")
    }

    /// rapier's parameters for frames of `frame_time` (s).
    pub(super) fn parameters(&self, frame_time: f64) -> rapier::IntegrationParameters {
        let softness = rapier::SpringCoefficients::new(FREQUENCY, DAMPING_RATIO);
        rapier::IntegrationParameters {
            dt: frame_time / self.steps as f64,
            num_solver_iterations: self.iterations,
            contact_softness: softness,
            static_contact_softness: softness,
            length_unit: LENGTH,
            // For a robot that is one free body; the simplified model is up to 10 % off on small feet. Multibodies always use this one.
            friction_model: rapier::FrictionModel::Coulomb,
            // Motion clamping loses time, a speed limit loses energy, a recycled contact is stale.
            max_ccd_substeps: 0,
            normalized_max_linear_velocity: f64::MAX,
            contact_recycling: false,
            ..Default::default()
        }
    }
}
