//! Every task: values against states computed by hand, episodes, kernels.

#[path = "../../../nerd-sim/tests/cpp/mod.rs"]
mod cpp;
mod episodes;
mod file;
mod gradients;
mod kernels;
mod lead;
mod rewards;
mod steps;

use nerd_sim::articulated::device::{Reach, records};
use nerd_sim::{prelude::*, system::Source};
use nerd_tasks::{Episodes, named, names};

/// A task with a clock and a reward of several terms.
const GAIT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/tasks/gait.toml@anymal");

/// Built-in tasks, two tasks for any robot (one with a memory of actions), and one of these tests.
fn every() -> Vec<&'static str> {
    names().into_iter().chain(["walk@anymal", "reach@franka", GAIT]).collect()
}

fn solver(which: &str, system: &System) -> Box<dyn Solver> {
    match which {
        "rapier" => Box::new(Rapier::new(RapierConfig::default())),
        // A cable's springs need an implicit method.
        _ if system.source == Source::Cable => {
            Box::new(Articulated::new(ArticulatedConfig::implicit(2, Friction::Coulomb)))
        }
        _ => Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
    }
}

fn episodes(name: &str, which: &str, n: usize) -> Episodes {
    let task = named(name).expect("registered");
    let system = task.system().expect("built in");
    let scene = system.scene(task.scene()).expect("a scene of the robot");
    let solver = solver(which, &system);
    Episodes::new(task, Simulation::new(Batch::new(&system, &scene, n), solver), 7)
}

/// Actions, nonzero and different for all environments and frames.
fn actions(episodes: &Episodes, step: usize) -> Vec<f64> {
    let n = episodes.len() * episodes.task.action_dim();
    (0..n).map(|i| 0.7 * ((i * 37 + step * 11) as f64).sin()).collect()
}

/// Deterministic numbers about 0, of magnitude `size`.
fn some(n: usize, seed: usize, size: f64) -> Vec<f64> {
    (0..n).map(|k| size * (1.7 * (k + 31 * seed) as f64 + 0.3).sin()).collect()
}

/// Largest difference, relative to the largest expected number; NaN is the worst.
fn apart(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(1e-6, |most: f64, x| most.max(x.abs()));
    let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs() / largest);
    off.fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

/// Every environment's scene and robot as kernel data.
fn recorded(batch: &Batch) -> Vec<f64> {
    // Scenes that are not shared get one record each.
    let scenes = batch.scenes.iter().map(|scene| Arc::new((**scene).clone())).collect();
    records(&Batch { scenes, ..batch.clone() }, Reach::of(batch)).expect("scenes with kernels").0
}
