//! Turns that count from the root: what they mean, and that they can be undone.

use std::sync::Arc;

use nalgebra::UnitQuaternion;
use nerd_core::dynamics::{Data, kinematics, link_pose};
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::form::Form;
use nerd_model::turns::Turns;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

const ROOT: Form = Form { base: Base::Draft(1), view: nerd_model::form::View::Own, turns: Turns::Root };

fn cable() -> Arc<System> {
    let toml = "[cable]\nlength = 1.0\ndiameter = 0.008\nmass = 0.08\nbending = 1e-3\nlinks = 10\ntwisting = 1e-3";
    Arc::new(System::from_toml("cable", toml).expect("a cable"))
}

fn robots() -> Vec<Arc<System>> {
    let named = ["pendulum", "cartpole", "franka", "cube", "ant", "anymal"].map(|name| System::named(name).expect("built in"));
    named.into_iter().chain([cable()]).collect()
}

/// What is learned is what is applied, for whatever a joint's turn counts from.
#[test]
fn a_target_that_counts_from_the_root_leads_back_to_the_next_state() {
    for system in robots() {
        let d = system.robot.state_dim();
        let mut features = Features::new(&system, ROOT);
        let mut worst: f64 = 0.0;
        for k in 0..20 {
            let [state, base, next] = [0, 1, 2].map(|i| start(&system, Start::Sample, &mut stream(11, 3 * k + i)));
            let (mut target, mut back) = (vec![0.0f32; d], vec![0.0; d]);
            features.target(&state, &base, &next, &mut target);
            let target: Vec<f64> = target.iter().map(|x| f64::from(*x)).collect();
            features.apply(&state, &base, &target, &mut back);
            let first = system.robot.root_coords();
            for (i, joint) in system.robot.joints().enumerate() {
                let gap = next[first + i] - back[first + i];
                worst = worst.max(if joint.wraps() { nerd_core::state::wrap(gap) } else { gap }.abs());
            }
            let rates = system.robot.nq() + system.robot.root_dofs();
            let size = 1.0 + next[rates..].iter().chain(&base[rates..]).map(|x| x.abs()).fold(0.0, f64::max);
            worst = next[rates..].iter().zip(&back[rates..]).map(|(a, b)| (a - b).abs() / size).fold(worst, f64::max);
        }
        // Targets are f32, and along a chain they add up.
        assert!(worst < 3e-5, "{}: {worst:.1e} apart", system.name);
    }
}

/// Two hinges about one axis: the second link turns by what both joints turn.
#[test]
fn parallel_hinges_add_up() {
    let system = System::named("pendulum").expect("built in");
    let mut target = [0.0f32; 4];
    let (state, next) = ([0.1, 0.2, 0.0, 0.0], [0.15, 0.5, 1.0, 2.0]);
    Features::new(&system, Form { base: Base::State, ..ROOT }).target(&state, &state, &next, &mut target);
    for (found, wanted) in target.iter().zip([0.05, 0.35, 1.0, 3.0]) {
        assert!((f64::from(*found) - wanted).abs() < 1e-6, "{target:?}");
    }
}

/// An error in what is said of one rod turns that rod, and of a straight cable to first order no other.
#[test]
fn an_error_of_one_link_stays_with_it() {
    let system = cable();
    let robot = &system.robot;
    let mut features = Features::new(&system, ROOT);
    let state = robot.zero_state();
    let poses = |features: &mut Features, change: &[f64]| -> Vec<UnitQuaternion<f64>> {
        let (mut next, mut data) = (vec![0.0; robot.state_dim()], Data::new(robot));
        features.apply(&state, &state, change, &mut next);
        kinematics(robot, &next, &mut data);
        robot.contact_points.iter().map(|p| link_pose(&data, p.link).rotation).collect()
    };
    let mut change = vec![0.0; robot.state_dim()];
    let before = poses(&mut features, &change);
    // The three hinges of the fifth rod, behind six axes of the gripper.
    change[6 + 4 * 3..6 + 5 * 3].fill(1e-3);
    let turned: Vec<f64> = poses(&mut features, &change).iter().zip(&before).map(|(a, b)| a.angle_to(b)).collect();
    for (k, angle) in turned.iter().enumerate() {
        if k == 4 {
            assert!(*angle > 1e-3, "the fifth rod turns by {angle} rad");
        } else {
            assert!(*angle < 1e-5, "rod {} turns by {angle} rad", k + 1);
        }
    }
}
