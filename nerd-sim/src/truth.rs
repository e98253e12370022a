//! The solvers of [`Truth`], from which models learn.

use crate::internal::*;
#[cfg(feature = "rapier")]
use crate::rapier::{Rapier, RapierConfig};
#[cfg(feature = "rapier")]
use crate::system::truth::{ITERATIONS, STEPS};
pub use crate::system::truth::{RECORDED, Truth};

impl Truth {
    /// The solver itself.
    pub fn solver(self, system: &System) -> Box<dyn Solver> {
        match self {
            Self::Articulated => Box::new(Articulated::new(ArticulatedConfig::accurate(system))),
            Self::Paper => Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
            #[cfg(feature = "rapier")]
            Self::Rapier => Box::new(Rapier::new(Self::rapier())),
        }
    }

    /// rapier's settings as a truth.
    #[cfg(feature = "rapier")]
    pub fn rapier() -> RapierConfig {
        RapierConfig { steps: STEPS, iterations: ITERATIONS, ..Default::default() }
    }
}
