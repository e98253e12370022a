//! The columns: solvers and their settings.

use std::sync::Arc;

use nerd_sim::prelude::*;
use nerd_sim::rapier::Joints;

/// A solver at certain settings.
pub struct Method {
    /// Name of the column.
    pub name: &'static str,
    /// Makes it for a system.
    pub make: fn(&Arc<System>) -> Box<dyn Solver>,
    /// The same with four times the substeps.
    pub finer: fn(&Arc<System>) -> Box<dyn Solver>,
}

fn paper(system: &Arc<System>, times: usize) -> Box<dyn Solver> {
    let config = ArticulatedConfig::paper(system, Friction::Coulomb);
    let (substeps, contact_substeps) = (times * config.substeps, times * config.contact_substeps);
    Box::new(Articulated::new(ArticulatedConfig { substeps, contact_substeps, ..config }))
}

fn euler(substeps: usize) -> Box<dyn Solver> {
    Box::new(Articulated::new(ArticulatedConfig::explicit(substeps, Friction::Coulomb)))
}

fn implicit(substeps: usize) -> Box<dyn Solver> {
    Box::new(Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb)))
}

fn rapier(joints: Joints, steps: usize) -> Box<dyn Solver> {
    Box::new(Rapier::new(RapierConfig { steps, joints, ..Default::default() }))
}

/// All of them; `converged` is the one that known physics must pass.
pub const METHODS: [Method; 10] = [
    Method { name: "paper", make: |system| paper(system, 1), finer: |system| paper(system, 4) },
    Method { name: "Euler x4", make: |_| euler(4), finer: |_| euler(16) },
    Method { name: "Euler x16", make: |_| euler(16), finer: |_| euler(64) },
    Method { name: "Euler x64", make: |_| euler(64), finer: |_| euler(256) },
    Method { name: "implicit x4", make: |_| implicit(4), finer: |_| implicit(16) },
    Method { name: "implicit x16", make: |_| implicit(16), finer: |_| implicit(64) },
    Method {
        name: CONVERGED,
        make: |_| Box::new(Articulated::new(ArticulatedConfig::converged(Friction::Coulomb))),
        finer: |_| implicit(512),
    },
    Method { name: "rapier 4x4", make: |_| rapier(Joints::Multibody, 4), finer: |_| rapier(Joints::Multibody, 16) },
    Method { name: "rapier 16x4", make: |_| rapier(Joints::Multibody, 16), finer: |_| rapier(Joints::Multibody, 64) },
    Method { name: "rapier impulse", make: |_| rapier(Joints::Impulse, 4), finer: |_| rapier(Joints::Impulse, 16) },
];

/// Name of the accurate preset's column.
pub const CONVERGED: &str = "converged";
