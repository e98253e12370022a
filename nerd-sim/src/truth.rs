//! The solvers of [`Truth`], from which models learn.

#[cfg(feature = "rapier")]
use crate::rapier::{Rapier, RapierConfig};
#[cfg(feature = "rapier")]
use crate::system::truth::{ITERATIONS, STEPS};
pub use crate::system::truth::{RECORDED, Truth};
use crate::{internal::*, rig::Rig, vary::VarySpec};

impl Truth {
    /// The solver itself; wrapped in a motor and sensor model where these differ from robot to robot.
    pub fn solver(self, system: &System) -> Box<dyn Solver> {
        let bare = self.bare(system);
        if system.spec.vary.as_ref().is_some_and(VarySpec::rigged) { Box::new(Rig::new(bare)) } else { bare }
    }

    fn bare(self, system: &System) -> Box<dyn Solver> {
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
        RapierConfig { steps: STEPS, iterations: ITERATIONS, own_axes: true, ..Default::default() }
    }
}
