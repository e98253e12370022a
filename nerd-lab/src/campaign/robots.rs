//! Good robots to start from, and what is done with those that come of them.

use std::sync::Arc;

use nerd_core::dynamics::Data;
use nerd_sim::prelude::*;
use nerd_sim::scene::contacts;
use rand::Rng;

use crate::campaign::case::{Fault, Judged, fault};
use crate::campaign::mutate::pick;

/// Frames stepped.
const FRAMES: usize = 3;

/// Specification and URDF of a robot, the small ones more often: a case of theirs takes less time.
pub fn robot(rng: &mut impl Rng) -> (&'static str, &'static str) {
    texts(pick(rng, "cartpole cartpole pendulum pendulum pendulum cube cube franka ant anymal pendulum-paper cube-paper ant-paper"))
}

/// Specification and URDF of a robot that is built in.
pub fn texts(name: &str) -> (&'static str, &'static str) {
    System::texts(name).unwrap_or_default()
}

/// Steps a robot with each solver of ours, and rapier, from `state` with `torques`.
pub fn roll(system: &Arc<System>, scene: &Arc<Scene>, state: &[f64], torques: &[f64]) -> Judged {
    let solvers: [Box<dyn Solver>; 3] = [
        Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
        Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))),
        Box::new(Rapier::new(RapierConfig::default())),
    ];
    let mut refused = Ok(());
    for mut solver in solvers {
        let mut batch = Batch::new(system, scene, 1);
        batch.reset(0, state);
        refused = refused.and((0..FRAMES).try_for_each(|_| solver.step(&mut batch, torques)));
        // What was stepped last is there, error or not.
        let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
        contacts(&system.robot, scene, batch.state(0), &mut data, &mut events);
        if let Some(at) = batch.state(0).iter().position(|x| !x.is_finite()) {
            return fault(Fault::NotFinite, format!("`{}` is {}", system.spec.state_columns[at], batch.state(0)[at]));
        }
        let moderate = batch.state(0).iter().all(|x| x.abs() < 1e100);
        let mut wrong = events.iter().filter(|e| e.distance.is_nan() || !e.normal.iter().chain(&e.p1).all(|x| x.is_finite()));
        if let Some(event) = wrong.next().filter(|_| moderate) {
            return fault(Fault::NotFinite, format!("a contact is {event:?}"));
        }
    }
    Ok(refused?)
}

/// Refuses the first number of a robot or its specification that is none: whatever is accepted is finite, but for what is not
/// limited.
pub fn finite(system: &System) -> Judged {
    let text = format!("{system:?}");
    // Names may be anything.
    let bare: String = text.split('"').step_by(2).collect::<Vec<_>>().join("_");
    let unlimited = |before: &str| ["effort: ", "velocity: "].iter().any(|field| before.ends_with(field));
    let mut numbers = ["NaN", "inf"].into_iter().flat_map(|word| bare.match_indices(word));
    let wrong = numbers.find(|(at, _)| bare[..*at].ends_with([' ', '-', '[']) && !unlimited(&bare[..*at]));
    match wrong {
        Some((at, word)) => fault(Fault::NotFinite, bare[..at].rsplit(", ").next().unwrap_or_default().to_owned() + word),
        None => Ok(()),
    }
}
