//! The columns: solvers and their settings.

use std::sync::Arc;

use nerd_sim::prelude::*;

/// A solver at certain settings.
pub struct Method {
    /// Name of the column.
    pub name: &'static str,
    /// Makes it for a system.
    pub make: fn(&Arc<System>) -> Box<dyn Solver>,
}

fn euler(substeps: usize) -> Box<dyn Solver> {
    Box::new(Articulated::new(ArticulatedConfig::explicit(substeps, Friction::Coulomb)))
}

fn rapier(steps: usize, iterations: usize) -> Box<dyn Solver> {
    Box::new(Rapier::new(RapierConfig { steps, iterations, ..Default::default() }))
}

/// All of them; `converged` is the one that known physics must pass.
pub const METHODS: [Method; 9] = [
    Method { name: "paper", make: |system| Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))) },
    Method { name: "Euler x4", make: |_| euler(4) },
    Method { name: "Euler x16", make: |_| euler(16) },
    Method { name: "Euler x64", make: |_| euler(64) },
    Method { name: CONVERGED, make: |_| Box::new(Articulated::new(ArticulatedConfig::converged(Friction::Coulomb))) },
    Method { name: "implicit x4", make: |_| Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))) },
    Method { name: "implicit x16", make: |_| Box::new(Articulated::new(ArticulatedConfig::implicit(16, Friction::Coulomb))) },
    Method { name: "rapier 4x4", make: |_| rapier(4, 4) },
    Method { name: "rapier 16x4", make: |_| rapier(16, 4) },
];

/// Name of the accurate preset's column.
pub const CONVERGED: &str = "converged";
