//! The learned solver: windows grow, and end at a reset or a gap; environments are independent; a prediction of zero
//! change returns the base. Weights are random, not trained. Tolerance: f32 rounding, since a window's arithmetic may
//! be split into other chunks.

mod common;

use common::{POSITIONS, fallen, gap, model, placed};
use nerd_model::prelude::*;
use nerd_model::{base::Base, features::Features, transformer::Positions};
use nerd_sim::instruments::{Glide, Hold};

const BOUND: f64 = 1e-5;

fn simulation(scene: &str, n: usize, positions: Positions) -> Simulation {
    let system = System::named("pendulum").expect("built in");
    let mut batch = Batch::new(&system, &system.scene(scene).expect("scene"), n);
    batch.states.iter_mut().enumerate().for_each(|(i, x)| *x = (0.7 * i as f64).sin());
    Simulation::new(batch, learned(&system, positions))
}

fn run(simulation: &mut Simulation, frames: usize) {
    let torques = vec![3.0; simulation.batch.len() * 2];
    (0..frames).for_each(|_| simulation.step(&torques).expect("finite"));
}

#[test]
fn history_matters_and_a_reset_ends_it_for_that_environment_alone() {
    for positions in POSITIONS {
        let mut all = simulation("ground1", 3, positions);
        let mut undisturbed = simulation("ground1", 3, positions);
        run(&mut all, 14);
        let state = all.batch.state(1).to_vec();
        all.reset(1, &state);
        let mut fresh = simulation("ground1", 1, positions);
        fresh.reset(0, &state);
        run(&mut all, 12);
        run(&mut fresh, 12);
        run(&mut undisturbed, 26);
        let difference = gap(all.batch.state(1), fresh.batch.state(0));
        assert!(difference < BOUND, "reset against fresh: {difference:.1e}");
        let difference = gap(all.batch.state(2), undisturbed.batch.state(2));
        assert!(difference < BOUND, "the neighbour noticed: {difference:.1e}");
        let difference = gap(all.batch.state(1), undisturbed.batch.state(1));
        assert!(
            difference > 10.0 * BOUND,
            "with and without history alike ({difference:.1e}): the network sees no history"
        );
    }
}

#[test]
fn frames_of_another_solver_in_between_empty_the_window() {
    for positions in POSITIONS {
        let mut swapped = simulation("ground1", 2, positions);
        let system = swapped.batch.system.clone();
        run(&mut swapped, 8);
        let mut truth: Box<dyn Solver> =
            Box::new(Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb)));
        std::mem::swap(&mut truth, &mut swapped.solver);
        run(&mut swapped, 3);
        std::mem::swap(&mut truth, &mut swapped.solver);
        let mut fresh = simulation("ground1", 2, positions);
        (0..2).for_each(|env| fresh.reset(env, swapped.batch.state(env)));
        run(&mut swapped, 5);
        run(&mut fresh, 5);
        let difference = gap(&swapped.batch.states, &fresh.batch.states);
        assert!(difference < BOUND, "tokens from before the swap were used: {difference:.1e}");
    }
}

/// `n` environments at random start states, and torques for them.
fn batch(system: &Arc<System>, scene: &str, n: usize) -> (Batch, Vec<f64>) {
    let batch = fallen(system, scene, n, (Start::Sample, 41), 0);
    let torques = (0..n * system.robot.joint_count()).map(|i| 20.0 * (i as f64).cos()).collect();
    (batch, torques)
}

fn learned(system: &Arc<System>, positions: Positions) -> Neural {
    Neural::on_cpu(placed(system, Base::State, positions))
}

fn roll(solver: &mut dyn Solver, batch: &mut Batch, torques: &[f64], frames: usize) {
    (0..frames).for_each(|_| solver.step(batch, torques).expect("finite"));
}

#[test]
fn an_environment_is_that_environment_alone() {
    for positions in POSITIONS {
        let system = System::named("pendulum").expect("built in");
        let (first, torques) = batch(&system, "ground1", 6);
        let mut all = first.clone();
        roll(&mut learned(&system, positions), &mut all, &torques, 25);
        for env in 0..6 {
            let mut alone = Batch::new(&system, &first.scenes[env], 1);
            alone.reset(0, first.state(env));
            roll(&mut learned(&system, positions), &mut alone, &torques[2 * env..2 * env + 2], 25);
            let difference = gap(alone.state(0), all.state(env));
            assert!(difference < BOUND, "environment {env} of 6 and alone: {difference:.1e}");
        }
    }
}

/// Robots in scenes: free, on one plane, on a tilted plane.
const CASES: [(&str, &str); 6] = [
    ("cartpole", "free"),
    ("pendulum", "ground1"),
    ("pendulum", "ground2"),
    ("cube", "ground"),
    ("ant", "ground"),
    ("anymal", "ground"),
];

/// The outputs for zero change. A rotation is a quaternion, so they are not all zero.
fn nothing(system: &Arc<System>) -> Vec<f64> {
    let (state, mut target) = (system.default_state(), vec![0.0f32; system.robot.state_dim()]);
    Features::new(system, Base::State).target(&state, &state, &mut target);
    target.into_iter().map(f64::from).collect()
}

#[test]
fn a_network_that_says_nothing_leaves_its_base() {
    for (robot, scene) in CASES {
        let system = System::named(robot).expect("built in");
        let (first, torques) = batch(&system, scene, 5);
        for positions in POSITIONS {
            // A free root keeps its twist about the world's origin, so its position does not move as in `Glide`.
            for base in if system.robot.floating() { &[Base::State][..] } else { &[Base::State, Base::Trapezoid] } {
                let (mut learned, mut raw) = (first.clone(), first.clone());
                let mut silent = placed(&system, *base, positions);
                silent.weights.flat.fill(0.0);
                silent.normalizer.outputs.mean = nothing(&system);
                let mut still: Box<dyn Solver> = if *base == Base::State { Box::new(Hold) } else { Box::new(Glide) };
                roll(&mut Neural::on_cpu(silent), &mut learned, &torques, 30);
                roll(&mut *still, &mut raw, &torques, 30);
                let apart = gap(&learned.states, &raw.states);
                assert!(apart < 1e-9, "{robot} on {scene}, {base:?}: {apart:.1e} from the base alone");
            }
        }
        // A network with other outputs has an effect, also in scenes without contact.
        let mut learned = first.clone();
        roll(&mut Neural::on_cpu(model(&system, Base::State)), &mut learned, &torques, 1);
        let apart: Vec<f64> = (0..5).map(|env| gap(learned.state(env), first.state(env))).collect();
        assert!(apart.iter().all(|gap| *gap > 1e-6), "{robot} on {scene}: the network is not heard, {apart:?}");
    }
}

#[test]
fn what_cannot_be_moved_is_set_aside_alone() {
    let system = System::named("pendulum").expect("built in");
    let (mut batch, torques) = batch(&system, "ground1", 4);
    let solver = || Neural::on_cpu(model(&system, Base::State));
    let mut whole = batch.clone();
    let mut scene = (*batch.scenes[2]).clone();
    scene.gravity = Vector3::new(0.0, f64::NAN, 0.0);
    batch.scenes[2] = Arc::new(scene);
    let before = batch.state(2).to_vec();
    let faults = solver().step(&mut batch, &torques).expect_err("no gravity").faults().expect("of environments");
    assert_eq!(faults.iter().map(|f| (f.env, f.frame)).collect::<Vec<_>>(), [(2, 0)], "{faults:?}");
    assert_eq!(batch.state(2), before, "what cannot be moved was moved");
    solver().step(&mut whole, &torques).expect("finite");
    for env in [0, 1, 3] {
        let apart = gap(batch.state(env), whole.state(env));
        assert!(apart < 1e-5, "environment {env} noticed: {apart:.1e}");
    }
}
