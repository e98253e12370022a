//! Random data with torques along smooth curves, among pegs at random places in each trajectory.

use nerd_sim::dataset::{Act, GenerateConfig, Smooth, begin, record};
use nerd_sim::prelude::*;

/// A cable of eight rods above four pegs.
fn lead() -> Arc<System> {
    let toml = "smooth = \"U(0.3, 0.5)\"\n[cable]\nlength = 1.0\ndiameter = 0.008\nmass = 0.08\nbending = 1e-3\ndamping = 1e-5\nlinks = 8\n\
                position = [0.0, 0.0, 0.5]\n[random_pegs]\ncount = 4\nradius = \"U(0.02, 0.04)\"\nheight = 0.6\n\
                position = [\"U(-0.2, 1.0)\", \"U(-0.3, 0.3)\", \"U(0, 0)\"]";
    System::from_toml("lead", toml).expect("a lead").into()
}

fn config() -> GenerateConfig {
    GenerateConfig { transitions: 480, frames: 60, seed: 3, ..GenerateConfig::default() }
}

#[test]
fn smooth_torques_hold_first_and_then_bend_without_a_corner() {
    let system = lead();
    let mut rng = stream(7, 0);
    let state = start(&system, Start::Sample, &mut rng);
    let mut curve = Smooth::new(&system, &state, 1.0, &mut rng).expect("the specification asks for it");
    let (joints, scene) = (system.robot.joint_count(), Scene::free(system.gravity()));
    let mut path = vec![vec![0.0; joints]; 200];
    path.iter_mut().for_each(|tau| curve.torques(&state, &scene, &mut rng, tau));
    for (k, (joint, said)) in system.robot.joints().zip(&system.spec.joints).enumerate() {
        let held = joint.stiffness * (state[k] - joint.rest);
        if said.torque == 0.0 {
            assert!(path.iter().all(|tau| tau[k] == 0.0), "{}: it has no random torque", joint.name);
            continue;
        }
        assert!(
            (path[0][k] - held).abs() < 1e-9 * said.torque,
            "{}: {} holds it, not {}",
            joint.name,
            held,
            path[0][k]
        );
        let most = path.iter().map(|tau| tau[k].abs()).fold(0.0, f64::max);
        assert!(most <= said.torque && most > 0.2 * said.torque, "{}: {most} of {}", joint.name, said.torque);
        // A cubic B-spline through values of at most T, h frames apart, has a second derivative of at most 4 T / h^2.
        let bend = path.windows(3).map(|w| (w[0][k] - 2.0 * w[1][k] + w[2][k]).abs()).fold(0.0, f64::max);
        let bound = 4.0 * said.torque / (0.3 * 60.0_f64).powi(2);
        assert!(bend <= bound * 1.001, "{}: second difference {bend}, bound {bound}", joint.name);
    }
    assert!(Smooth::new(&system, &state, 0.0, &mut rng).is_none(), "what is passive is not driven");
    let cartpole = System::named("cartpole").expect("built in");
    assert!(Smooth::new(&cartpole, &cartpole.robot.zero_state(), 1.0, &mut rng).is_none(), "torques that jump stay so");
}

#[test]
fn pegs_differ_by_trajectory_and_stand_clear_of_the_start() {
    let system = lead();
    let batch = begin(&system, &config(), 0, 8).expect("it begins");
    let again = begin(&system, &config(), 0, 8).expect("it begins");
    let (mut data, mut events, mut places) = (Data::new(&system.robot), Vec::new(), Vec::new());
    for env in 0..8 {
        let scene = &batch.scenes[env];
        assert!(
            (2..=5).contains(&scene.colliders.len()),
            "the ground and up to four pegs, not {}",
            scene.colliders.len()
        );
        contacts(&system, scene, batch.state(env), &mut data, &mut events);
        let least = events.iter().map(|e| e.distance).fold(f64::MAX, f64::min);
        assert!(least >= 0.004, "trajectory {env} starts {least} m from a surface");
        places.push(format!("{:?}", scene.colliders.iter().map(|c| c.pose).collect::<Vec<_>>()));
        assert_eq!(
            places[env],
            format!("{:?}", again.scenes[env].colliders.iter().map(|c| c.pose).collect::<Vec<_>>())
        );
    }
    assert!((1..8).all(|env| !places[..env].contains(&places[env])), "layouts differ");
}

#[test]
fn what_begins_is_what_is_recorded() {
    let system = lead();
    let mut batch = begin(&system, &config(), 0, 8).expect("it begins");
    let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
    let recording = record(&system, &mut solver, &config(), 0, 8).expect("it moves");
    // Under the recorded torques and among the same pegs the batch repeats the recording.
    for frame in 0..60 {
        assert_eq!(batch.states, recording.states_at(frame), "frame {frame}");
        solver.step(&mut batch, &recording.torques_at(frame)).expect("it moves");
    }
}
