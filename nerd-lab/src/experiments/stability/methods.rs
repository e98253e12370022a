//! The columns of the stability map.

use nerd_sim::{prelude::*, suite::Method};

/// Presets and substeps of [`Articulated`], and two settings of rapier.
pub fn known() -> Vec<Method> {
    let (rough, fine) = (rapier("rapier 4x4", 4), rapier("rapier 16x4", 16));
    [paper(), accurate(), euler(4), euler(16), euler(64), implicit(4), implicit(16), converged(), rough, fine].into()
}

/// The articulated solver with a system's settings, the substeps multiplied, as `solver` builds it.
pub(super) fn articulated(
    name: impl Into<String>,
    config: impl Fn(&System, usize) -> ArticulatedConfig + Copy + Send + Sync + 'static,
    solver: impl Fn(ArticulatedConfig) -> Box<dyn Solver> + Copy + Send + Sync + 'static,
) -> Method {
    let at = move |times: usize| move |system: &Arc<System>| solver(config(system, times));
    Method::new(name, at(1)).finer(at(4))
}

fn on_cpu(config: ArticulatedConfig) -> Box<dyn Solver> {
    Box::new(Articulated::new(config))
}

fn euler(n: usize) -> Method {
    articulated(format!("Euler x{n}"), move |_, times| ArticulatedConfig::explicit(times * n, Friction::Coulomb), on_cpu)
}

fn implicit(n: usize) -> Method {
    articulated(format!("implicit x{n}"), move |_, times| ArticulatedConfig::implicit(times * n, Friction::Coulomb), on_cpu)
}

/// What models are learned from: as many implicit substeps as the robot's specification says.
pub fn accurate() -> Method {
    articulated("accurate", |system, times| ArticulatedConfig::implicit(times * system.spec.substeps, Friction::Coulomb), on_cpu)
}

pub fn converged() -> Method {
    let substeps = ArticulatedConfig::converged(Friction::Coulomb).contact_substeps;
    articulated("converged", move |_, times| ArticulatedConfig::implicit(times * substeps, Friction::Coulomb), on_cpu)
}

/// The reference simulator's preset, with the materials and substeps that it has there.
pub fn paper() -> Method {
    let paper = |system: &System, times: usize| {
        let config = ArticulatedConfig::paper(system, Friction::Coulomb);
        ArticulatedConfig { substeps: times * config.substeps, contact_substeps: times * config.contact_substeps, ..config }
    };
    articulated("paper", paper, on_cpu).made_as("paper")
}

fn rapier(name: &str, steps: usize) -> Method {
    let at = |steps| move |_: &Arc<System>| -> Box<dyn Solver> { Box::new(Rapier::new(RapierConfig { steps, ..Default::default() })) };
    Method::new(name, at(steps)).finer(at(4 * steps)).rigid()
}
