//! Policies act in the share of the data that was asked for, as they would in episodes, and the same seed gives the same bytes.

use std::sync::Arc;

use nerd_sim::dataset::{GenerateConfig, record};
use nerd_sim::prelude::*;
use nerd_sim::sampling::stream;
use nerd_train::ppo::{Activation, Policies, Policy, Shape};

/// A policy that pulls all joints one way, hardly noisy.
fn one_way(task: &str, observation: usize, action: usize, stack: usize) -> (String, Policy) {
    let shape = Shape { observation, stack, action, hidden: vec![4], activation: Activation::Relu, spread_by_state: false };
    let mut policy = Policy::new(shape, &mut stream(0, 0));
    policy.flat.fill(0.0);
    let (outputs, end) = (action + 1, policy.flat.len() - action);
    policy.flat[end - outputs..end - 1].fill(0.25);
    policy.flat[end..].fill(-4.0);
    (task.into(), policy)
}

fn recording(robot: &str, policy: (String, Policy), share: f64) -> (nerd_sim::dataset::Recording, usize) {
    let system = System::named(robot).unwrap();
    let mut truth = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    let pilot = Some((Arc::new(Policies::new(vec![policy]).unwrap()) as _, share));
    let config = GenerateConfig { frames: 12, pilot, ..Default::default() };
    (record(&system, &mut truth, &config, 0, 40).unwrap(), system.robot.joint_count())
}

#[test]
fn policies_act_in_their_share_of_the_trajectories() {
    let (r, joints) = recording("ant", one_way("ant-run", 29, 8, 1), 0.5);
    // A quarter of 400 N m, give or take at most twice the spread of e^-4, six deviations of it.
    let led = |t: &usize| r.torques[t * 12 * joints..][..12 * joints].iter().all(|tau| (tau - 100.0).abs() < 400.0 * 2.0 * 0.0184 * 6.0);
    let count = (0..40).filter(led).count();
    assert!((10..=30).contains(&count), "a policy acts in {count} of 40 trajectories, half were asked for");
    let (again, _) = recording("ant", one_way("ant-run", 29, 8, 1), 0.5);
    assert!(r.torques == again.torques && r.states == again.states, "the same settings, other bytes");
    let (none, _) = recording("ant", one_way("ant-run", 29, 8, 1), 0.0);
    assert!(none.torques.iter().any(|tau| tau.abs() > 300.0), "random torques reach 400 N m");
}

#[test]
fn an_action_stays_for_the_frames_of_its_step_and_answers_each_state() {
    let (r, joints) = recording("franka", one_way("franka-reach", 13, 7, 4), 1.0);
    let torque = |t: usize, f: usize| &r.torques[(t * 12 + f) * joints..][..joints];
    let (mut moved, mut weak) = (0, 0);
    for t in 0..40 {
        for f in (0..12).step_by(2) {
            moved += usize::from(torque(t, f) != torque(t, f + 1));
            // The position law pulls to a quarter of 0.03125 rad ahead, from near rest: one way at the first frame.
            weak += usize::from(f == 0 && torque(t, 0).iter().any(|tau| *tau <= 0.0));
        }
    }
    assert!(moved == 240, "the law answers the state of each of the two frames of a step: {moved} of 240 differ");
    assert_eq!(weak, 0, "joints pulled the wrong way at the start of {weak} of 40 trajectories");
}
