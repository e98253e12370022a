//! What a batch promises for every solver: an environment is alone in its batch, a number of threads changes nothing, an
//! error names its place and leaves the states as they were.

use std::sync::Arc;

use nerd_sim::dataset::{GenerateConfig, record};
use nerd_sim::prelude::*;

const SOLVERS: [&str; 3] = ["paper", "implicit", "rapier"];

fn solver(name: &str, system: &System) -> Box<dyn Solver> {
    match name {
        "paper" => Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
        "implicit" => Box::new(Articulated::new(ArticulatedConfig::implicit(8, Friction::Huber))),
        _ => Box::new(Rapier::new(RapierConfig::default())),
    }
}

fn start(system: &Arc<System>, scene: &str, n: usize) -> Batch {
    let mut batch = Batch::new(system, &system.scene(scene).expect("scene"), n);
    batch.states.iter_mut().enumerate().for_each(|(i, x)| *x = 1.3 * (0.7 * i as f64).sin());
    batch
}

fn run(batch: &mut Batch, solver: &mut dyn Solver, frames: usize) {
    let torques: Vec<f64> = (0..batch.len() * batch.system.robot.joint_count()).map(|i| 20.0 * (i as f64).cos()).collect();
    (0..frames).for_each(|_| solver.step(batch, &torques).expect("finite"));
}

/// What one environment touches must not reach its neighbours, whose working memory it shares.
#[test]
fn environments_in_contact_leave_free_ones_alone() {
    let system = System::named("pendulum").expect("built in");
    let [free, ground] = ["free", "ground1"].map(|s| system.scene(s).expect("scene"));
    for config in [
        ArticulatedConfig::paper(&system, Friction::Coulomb),
        ArticulatedConfig::explicit(16, Friction::Coulomb),
        ArticulatedConfig::implicit(4, Friction::Coulomb),
    ] {
        let run = |scenes: [&std::sync::Arc<nerd_sim::scene::Scene>; 2]| {
            let mut batch = Batch::new(&system, scenes[0], 2);
            batch.scenes[1] = scenes[1].clone();
            let mut solver = Articulated::new(config);
            [[-1.0, -0.5, 0.0, 0.0], [0.4, 0.2, 0.0, 0.0]].iter().enumerate().for_each(|(env, s)| batch.reset(env, s));
            (0..60).for_each(|_| solver.step(&mut batch, &[0.0; 4]).expect("finite"));
            batch.state(1).to_vec()
        };
        assert_eq!(run([&ground, &free]), run([&free, &free]), "beside one on the ground, and beside a free one");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let system = System::named("pendulum").expect("built in");
    let config = GenerateConfig { frames: 30, ..GenerateConfig::default() };
    for name in SOLVERS {
        let hashes = [1, 2, 5].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
            pool.install(|| record(&system, &mut *solver(name, &system), &config, 7, 200).expect("recorded").sha256())
        });
        assert!(hashes.windows(2).all(|w| w[0] == w[1]), "{name}: bytes differ between 1, 2 and 5 threads");
    }
}

#[test]
fn a_trajectory_does_not_depend_on_the_shard_it_stands_in() {
    let system = System::named("pendulum").expect("built in");
    let config = GenerateConfig { frames: 30, ..GenerateConfig::default() };
    let take = |first, count| record(&system, &mut *solver("paper", &system), &config, first, count).expect("recorded").states;
    let (whole, part) = (take(0, 100), take(60, 40));
    assert_eq!(whole[60 * 31 * 4..], part[..], "trajectories 60..100 of one shard and of two");
}

#[test]
fn an_environment_that_is_reset_is_a_fresh_one_and_its_neighbours_do_not_notice() {
    for scene in ["free", "ground2"] {
        let system = System::named("pendulum").expect("built in");
        for name in SOLVERS {
            let (mut batch, mut one) = (start(&system, scene, 3), solver(name, &system));
            let mut undisturbed = batch.clone();
            run(&mut batch, &mut *one, 10);
            let state = [0.4, 0.1, -1.0, 2.0];
            let mut simulation = Simulation { batch, solver: one };
            simulation.reset(1, &state);
            assert_eq!((simulation.batch.frames[0], simulation.batch.frames[1]), (10, 0));
            let mut fresh = simulation.batch.clone();
            run(&mut simulation.batch, &mut *simulation.solver, 10);
            run(&mut fresh, &mut *solver(name, &system), 10);
            assert_eq!(simulation.batch.state(1), fresh.state(1), "{name}, {scene}: reset against fresh");
            run(&mut undisturbed, &mut *solver(name, &system), 20);
            assert_eq!(simulation.batch.state(2), undisturbed.state(2), "{name}, {scene}: neighbour");
        }
    }
}

#[test]
fn what_cannot_be_stepped_is_set_aside_with_its_address_and_harms_no_other() {
    let system = System::named("pendulum").expect("built in");
    for name in SOLVERS {
        let (mut batch, mut solver) = (start(&system, "ground1", 140), solver(name, &system));
        run(&mut batch, &mut *solver, 3);
        let before = batch.clone();
        let error = solver.step(&mut batch, &[0.0; 7]).expect_err("seven torques").to_string();
        assert!(error.contains('7') && error.contains("140"), "{name}: {error}");
        assert_eq!((&batch.states, &batch.frames), (&before.states, &before.frames), "{name}: changed by a refused step");
        let mut undisturbed = batch.clone();
        solver.step(&mut undisturbed, &[0.0; 280]).expect("finite");
        let mut torques = [0.0; 280];
        (torques[5], torques[201]) = (f64::NAN, f64::INFINITY);
        batch.state_mut(70)[3] = f64::NAN;
        let faults = solver.step(&mut batch, &torques).map_err(|e| (e.to_string(), e.faults().expect("of environments")));
        let (error, faults) = faults.expect_err("three that are no numbers");
        assert!(error.contains("environment 2, frame 3: ") && error.contains("2 environments more") && !error.contains('\n'), "{error}");
        assert_eq!(faults.iter().map(|f| f.env).collect::<Vec<_>>(), [2, 70, 100], "{name}: {error}");
        for env in 0..140 {
            if faults.iter().any(|f| f.env == env) {
                assert_eq!(batch.frames[env], 3, "{name}: environment {env} has not been stepped");
                let stays = batch.state(env).iter().zip(before.state(env)).all(|(a, b)| a == b || a.is_nan());
                assert!(stays, "{name}: environment {env} was moved");
            } else {
                assert_eq!(batch.state(env), undisturbed.state(env), "{name}: environment {env} noticed");
                assert_eq!(batch.frames[env], 4);
            }
        }
    }
}
