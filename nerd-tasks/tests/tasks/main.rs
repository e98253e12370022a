//! Every task: its numbers against states worked out by hand, its episodes, its kernels.

#[path = "../../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;
mod episodes;
mod kernels;
mod lead;
mod plan;
mod rewards;
mod slopes;
mod steps;

use nerd_sim::{prelude::*, system::Source};
use nerd_tasks::{Episodes, named};

fn solver(which: &str, system: &System) -> Box<dyn Solver> {
    match which {
        "rapier" => Box::new(Rapier::new(RapierConfig::default())),
        // A cable's springs want an implicit method.
        _ if system.source == Source::Cable => Box::new(Articulated::new(ArticulatedConfig::implicit(2, Friction::Coulomb))),
        _ => Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
    }
}

fn episodes(name: &str, which: &str, n: usize) -> Episodes {
    let task = named(name).expect("registered");
    let system = System::named(task.robot()).expect("built in");
    let scene = system.scene(task.scene()).expect("a scene of the robot");
    let solver = solver(which, &system);
    Episodes::new(task, Simulation::new(Batch::new(&system, &scene, n), solver), 7)
}

/// Actions that are neither zero nor the same for two environments or frames.
fn actions(episodes: &Episodes, step: usize) -> Vec<f64> {
    let n = episodes.len() * episodes.task.action_dim();
    (0..n).map(|i| 0.7 * ((i * 37 + step * 11) as f64).sin()).collect()
}
