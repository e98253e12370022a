//! Solvers of [`Truth`]: the simulators that models learn from.

#[cfg(feature = "rapier")]
use crate::rapier::{Rapier, RapierConfig};
#[cfg(feature = "rapier")]
use crate::robots::truth::{ITERATIONS, STEPS};
pub use crate::robots::truth::{RECORDED, Truth};
use crate::{internal::*, rig::rigged};

impl Truth {
    /// The solver, wrapped in an actuator and sensor model if the robot's `[vary]` has ranges for actuators or sensors.
    pub fn solver(self, system: &System) -> Box<dyn Solver> {
        rigged(self.bare(system), system)
    }

    fn bare(self, system: &System) -> Box<dyn Solver> {
        match self {
            Self::Articulated => Box::new(Articulated::new(ArticulatedConfig::accurate(system))),
            Self::Paper => Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
            #[cfg(feature = "rapier")]
            Self::Rapier => Box::new(Rapier::new(RapierConfig {
                steps: STEPS,
                iterations: ITERATIONS,
                own_axes: true,
                ..Default::default()
            })),
        }
    }
}
