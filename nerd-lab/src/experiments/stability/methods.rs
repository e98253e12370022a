//! The columns of the stability map.

use nerd_sim::{prelude::*, suite::Method};

/// Presets and substeps of [`Articulated`], and two settings of rapier.
pub fn known() -> Vec<Method> {
    let euler = |n| articulated(format!("Euler x{n}"), ArticulatedConfig::explicit, n);
    let implicit = |n| articulated(format!("implicit x{n}"), ArticulatedConfig::implicit, n);
    [
        paper(),
        accurate(),
        euler(4),
        euler(16),
        euler(64),
        implicit(4),
        implicit(16),
        converged(),
        rapier("rapier 4x4", 4),
        rapier("rapier 16x4", 16),
    ]
    .into()
}

/// What models are learned from: as many implicit substeps as the robot's specification says.
pub fn accurate() -> Method {
    let accurate = |system: &System, times: usize| -> Box<dyn Solver> {
        Box::new(Articulated::new(ArticulatedConfig::implicit(times * system.spec.substeps, Friction::Coulomb)))
    };
    Method::new("accurate", move |system| accurate(system, 1)).finer(move |system| accurate(system, 4))
}

pub fn converged() -> Method {
    Method::new("converged", |_| Box::new(Articulated::new(ArticulatedConfig::converged(Friction::Coulomb))))
        .finer(|_| Box::new(Articulated::new(ArticulatedConfig::implicit(512, Friction::Coulomb))))
}

/// The reference simulator's preset, with the materials and substeps that it has there.
pub fn paper() -> Method {
    let paper = |system: &System, times: usize| -> Box<dyn Solver> {
        let config = ArticulatedConfig::paper(system, Friction::Coulomb);
        let (substeps, contact_substeps) = (times * config.substeps, times * config.contact_substeps);
        Box::new(Articulated::new(ArticulatedConfig { substeps, contact_substeps, ..config }))
    };
    Method::new("paper", move |system| paper(system, 1)).finer(move |system| paper(system, 4)).made_as("paper")
}

fn articulated(name: String, config: fn(usize, Friction) -> ArticulatedConfig, substeps: usize) -> Method {
    let solver = move |n: usize| -> Box<dyn Solver> { Box::new(Articulated::new(config(n, Friction::Coulomb))) };
    Method::new(name, move |_| solver(substeps)).finer(move |_| solver(4 * substeps))
}

fn rapier(name: &str, steps: usize) -> Method {
    let solver = move |steps: usize| -> Box<dyn Solver> { Box::new(Rapier::new(RapierConfig { steps, ..Default::default() })) };
    Method::new(name, move |_| solver(steps)).finer(move |_| solver(4 * steps)).rigid()
}
