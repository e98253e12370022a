//! Good robots to start from, and what is done with those that come of them.

use std::sync::Arc;

use nerd_core::dynamics::Data;
use nerd_sim::batch::contacts;
use nerd_sim::prelude::*;
use rand::{Rng, RngExt};

use super::case::{Fault, Verdict};

/// Name, specification and URDF.
macro_rules! assets {
    ($($name:literal),*) => {
        [$((
            $name,
            include_str!(concat!("../../../nerd-sim/assets/", $name, ".toml")),
            include_str!(concat!("../../../nerd-sim/assets/", $name, ".urdf")),
        )),*]
    };
}

/// Robots to be changed.
pub const ROBOTS: [(&str, &str, &str); 6] = assets!("cartpole", "pendulum", "cube", "franka", "ant", "anymal");

/// Frames stepped.
const FRAMES: usize = 3;

/// One of [`ROBOTS`], the small ones more often: a case of theirs takes less time.
pub fn robot(rng: &mut impl Rng) -> (&'static str, &'static str, &'static str) {
    ROBOTS[[0, 0, 1, 1, 1, 2, 2, 3, 4, 5][rng.random_range(0..10)]]
}

/// Steps a robot with each solver of ours, and rapier, from `state` with `torques`.
pub fn roll(system: &Arc<System>, scene: &Arc<Scene>, state: &[f64], torques: &[f64]) -> Verdict {
    let paper = ArticulatedConfig::paper(system, Friction::Coulomb);
    let solvers: [Box<dyn Solver>; 3] = [
        Box::new(Articulated::new(paper)),
        Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))),
        Box::new(Rapier::new(RapierConfig::default())),
    ];
    let mut refused = None;
    for mut solver in solvers {
        let mut batch = Batch::new(system, scene, 1);
        batch.reset(0, state);
        if let Err(e) = (0..FRAMES).try_for_each(|_| solver.step(&mut batch, torques)) {
            refused.get_or_insert(e.to_string());
        }
        // What was stepped last is there, error or not.
        let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
        contacts(system, scene, batch.state(0), &mut data, &mut events);
        if let Some(at) = batch.state(0).iter().position(|x| !x.is_finite()) {
            return Verdict::Fault(Fault::NotFinite, format!("`{}` is {}", system.spec.state_columns[at], batch.state(0)[at]));
        }
        if let Some(k) = events.iter().position(|e| e.distance.is_nan() || !e.normal.iter().chain(&e.p1).all(|x| x.is_finite())) {
            let moderate = batch.state(0).iter().all(|x| x.abs() < 1e100);
            if moderate {
                return Verdict::Fault(Fault::NotFinite, format!("contact {k} is {:?}", events[k]));
            }
        }
    }
    refused.map_or(Verdict::Accepted, Verdict::Refused)
}

/// The first number of a robot or its specification that is none: whatever is accepted is finite, but for what is not limited.
pub fn not_finite(system: &System) -> Option<String> {
    let text = format!("{system:?}");
    // Names may be anything.
    let bare: String = text.split('"').step_by(2).collect::<Vec<_>>().join("_");
    let unlimited = |before: &str| ["effort: ", "velocity: "].iter().any(|field| before.ends_with(field));
    let numbers = ["NaN", "inf"].into_iter().flat_map(|word| bare.match_indices(word).map(|(at, _)| at).collect::<Vec<_>>());
    let mut wrong = numbers.filter(|at| bare[..*at].ends_with([' ', '-', '[']) && !unlimited(&bare[..*at]));
    wrong.next().map(|at| bare[..at + 3].chars().rev().take(40).collect::<Vec<_>>().into_iter().rev().collect())
}
