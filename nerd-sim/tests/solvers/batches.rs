//! Guarantees of a batch with every solver. Environments do not affect each other, and the number of threads changes
//! nothing. An error names its place and leaves the states as they were.

use super::common::*;

const SOLVERS: [&str; 3] = ["paper", "implicit", "rapier"];

fn solver(name: &str, system: &System) -> Box<dyn Solver> {
    match name {
        "paper" => Box::new(Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb))),
        "implicit" => Box::new(Articulated::new(ArticulatedConfig::implicit(8, Friction::Huber))),
        _ => Box::new(Rapier::new(RapierConfig::default())),
    }
}

fn start(system: &Arc<System>, scene: &str, n: usize) -> Batch {
    let mut batch = batch(system, scene, n);
    batch.states.iter_mut().enumerate().for_each(|(i, x)| *x = 1.3 * (0.7 * i as f64).sin());
    batch
}

fn driven(batch: &mut Batch, solver: &mut dyn Solver, frames: usize) {
    let torques: Vec<f64> =
        (0..batch.len() * batch.system.robot.joint_count()).map(|i| 20.0 * (i as f64).cos()).collect();
    (0..frames).for_each(|_| solver.step(batch, &torques).expect("finite"));
}

/// Contacts of one environment must not affect its neighbour, which shares the working memory.
#[test]
fn environments_in_contact_leave_free_ones_alone() {
    let system = built_in("pendulum");
    for config in [
        ArticulatedConfig::paper(&system, Friction::Coulomb),
        ArticulatedConfig::explicit(16, Friction::Coulomb),
        ArticulatedConfig::implicit(4, Friction::Coulomb),
    ] {
        let [beside_contact, beside_free] = ["ground1", "free"].map(|scene| {
            let mut batch = batch(&system, "free", 2);
            batch.scenes[0] = system.scene(scene).expect("scene");
            [[-1.0, -0.5, 0.0, 0.0], [0.4, 0.2, 0.0, 0.0]].iter().enumerate().for_each(|(env, s)| batch.reset(env, s));
            end(&mut Articulated::new(config), batch, 0.0, 60)[4..].to_vec()
        });
        assert_eq!(beside_contact, beside_free, "beside one on the ground, and beside a free one");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads_and_in_any_shard() {
    let (system, config) = (built_in("pendulum"), GenerateConfig { frames: 30, ..GenerateConfig::default() });
    for name in SOLVERS {
        let take =
            |first, count| record(&system, &mut *solver(name, &system), &config, first, count).expect("recorded");
        let hashes = [1, 2, 5].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
            pool.install(|| take(7, 200).sha256())
        });
        assert!(hashes.windows(2).all(|w| w[0] == w[1]), "{name}: bytes differ between 1, 2 and 5 threads");
        assert_eq!(
            take(0, 100).states[60 * 31 * 4..],
            take(60, 40).states,
            "{name}: trajectories 60..100 of one shard and of two"
        );
    }
}

#[test]
fn an_environment_that_is_reset_is_a_fresh_one_and_its_neighbours_do_not_notice() {
    let system = built_in("pendulum");
    for (scene, name) in ["free", "ground2"].into_iter().flat_map(|scene| SOLVERS.map(|name| (scene, name))) {
        let (mut batch, mut one) = (start(&system, scene, 3), solver(name, &system));
        let mut undisturbed = batch.clone();
        driven(&mut batch, &mut *one, 10);
        let mut simulation = Simulation { batch, solver: one };
        simulation.reset(1, &[0.4, 0.1, -1.0, 2.0]);
        assert_eq!((simulation.batch.frames[0], simulation.batch.frames[1]), (10, 0));
        let mut fresh = simulation.batch.clone();
        driven(&mut simulation.batch, &mut *simulation.solver, 10);
        driven(&mut fresh, &mut *solver(name, &system), 10);
        assert_eq!(simulation.batch.state(1), fresh.state(1), "{name}, {scene}: reset against fresh");
        driven(&mut undisturbed, &mut *solver(name, &system), 20);
        assert_eq!(simulation.batch.state(2), undisturbed.state(2), "{name}, {scene}: neighbour");
    }
}

#[test]
fn what_cannot_be_stepped_is_set_aside_with_its_address_and_harms_no_other() {
    let system = built_in("pendulum");
    for name in SOLVERS {
        let (mut batch, mut solver) = (start(&system, "ground1", 140), solver(name, &system));
        driven(&mut batch, &mut *solver, 3);
        let before = batch.clone();
        let said = line(solver.step(&mut batch, &[0.0; 7]));
        assert!(said.contains('7') && said.contains("140"), "{name}: {said}");
        assert_eq!(
            (&batch.states, &batch.frames),
            (&before.states, &before.frames),
            "{name}: changed by a refused step"
        );
        let mut undisturbed = batch.clone();
        solver.step(&mut undisturbed, &[0.0; 280]).expect("finite");
        let mut torques = [0.0; 280];
        (torques[5], torques[201]) = (f64::NAN, f64::INFINITY);
        batch.state_mut(70)[3] = f64::NAN;
        let error = solver.step(&mut batch, &torques).expect_err("three that are not finite");
        let (said, faults) = (error.to_string(), error.faults().expect("of environments"));
        assert!(
            said.contains("environment 2, frame 3: ") && said.contains("2 environments more") && !said.contains('\n'),
            "{said}"
        );
        assert_eq!(faults.iter().map(|f| f.env).collect::<Vec<_>>(), [2, 70, 100], "{name}: {said}");
        for env in 0..140 {
            if faults.iter().any(|f| f.env == env) {
                assert_eq!(batch.frames[env], 3, "{name}: environment {env} has not been stepped");
                let stays = batch.state(env).iter().zip(before.state(env)).all(|(a, b)| a == b || a.is_nan());
                assert!(stays, "{name}: environment {env} was moved");
            } else {
                assert_eq!(
                    (batch.state(env), batch.frames[env]),
                    (undisturbed.state(env), 4),
                    "{name}: environment {env} noticed"
                );
            }
        }
    }
}
