//! Settings of rapier.

use rapier3d_f64::prelude as rapier;

use crate::{internal::*, system::MAX_SUBSTEPS};

/// Natural frequency of contacts (Hz), and their damping ratio (rapier's default). At rapier's default of 60 Hz a
/// resting robot penetrates by 0.7 mm, here by 0.04 mm.
const FREQUENCY: f64 = 240.0;
const DAMPING_RATIO: f64 = 10.0;
/// Typical length of the scene (m), which scales rapier's tolerances: size of a robot's links.
const LENGTH: f64 = 0.1;

/// Settings of [`super::Rapier`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RapierConfig {
    /// Solver iterations (rapier's substeps) per outer step, at least 1. Default 4.
    pub iterations: usize,
    /// Outer steps per frame, each with collision detection and a check of limits, at least 1. Default 4. With
    /// a single step, a fast link can pass through a thin surface unnoticed. The double pendulum then penetrates by
    /// 0.1 m instead of 0.01 m.
    pub steps: usize,
    /// Restitution of every contact, 0 to 1. Default 0. The restitution replaces the damping of the compliant contact
    /// model.
    pub restitution: f64,
    /// Whether a floating robot's frame is stepped in the axes of its root at the start of the frame. Default no.
    /// rapier's friction acts along two axes of its world, so the result depends on the robot's heading. On the Ant,
    /// this dependence is more than half as large as the effect of more steps.
    pub own_axes: bool,
}

impl Default for RapierConfig {
    fn default() -> Self {
        Self { iterations: 4, steps: 4, restitution: 0.0, own_axes: false }
    }
}

impl RapierConfig {
    pub(super) fn check(&self) -> Result<(), String> {
        within("rapier: iterations", self.iterations as f64, 1.0..=MAX_SUBSTEPS as f64, "")?;
        within("rapier: steps", self.steps as f64, 1.0..=MAX_SUBSTEPS as f64, "")?;
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
            // A single free body needs Coulomb friction: rapier's simplified model errs by up to 10 % on small feet.
            // Multibodies always use Coulomb friction.
            friction_model: rapier::FrictionModel::Coulomb,
            // Motion clamping loses time, a speed limit loses energy, a recycled contact is stale.
            max_ccd_substeps: 0,
            normalized_max_linear_velocity: f64::MAX,
            contact_recycling: false,
            ..Default::default()
        }
    }
}
