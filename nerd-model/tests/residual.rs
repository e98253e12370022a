//! The residual form: predictions added to a frame of flight. Where nothing can be touched the network has no say; where it
//! has, an environment is its own, forgets at a reset, and sees neither where nor which way the world stands. Weights are
//! random: none of this is learned.

mod common;

use std::sync::Arc;

use common::{POSITIONS, gap, model, placed};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use nerd_core::dynamics::Data;
use nerd_core::state::{quaternion, vector, wrap, write_quaternion};
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::neural::Neural;
use nerd_model::transformer::Positions;
use nerd_sim::batch::contacts;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use nerd_sim::scene::{Collider, Plane};

/// Rounding of f32, since a window's arithmetic may be cut in other chunks.
const BOUND: f64 = 1e-5;

fn named(robot: &str) -> Arc<System> {
    System::named(robot).expect("built in")
}

/// `n` environments at starts of the training box, and torques for them.
fn batch(system: &Arc<System>, scene: &str, n: usize) -> (Batch, Vec<f64>) {
    let mut batch = Batch::new(system, &system.scene(scene).expect("scene"), n);
    (0..n).for_each(|env| batch.reset(env, &start(system, Start::Sample, &mut stream(41, env as u64))));
    let torques = (0..n * system.robot.joint_count()).map(|i| 20.0 * (i as f64).cos()).collect();
    (batch, torques)
}

fn learned(system: &Arc<System>, positions: Positions) -> Neural {
    Neural::on_cpu(placed(system, Base::Flight, positions), system)
}

fn run(solver: &mut dyn Solver, batch: &mut Batch, torques: &[f64], frames: usize) {
    (0..frames).for_each(|_| solver.step(batch, torques).expect("finite"));
}

#[test]
fn where_nothing_is_there_to_touch_it_is_the_truth_to_the_bit() {
    for robot in ["pendulum", "ant"] {
        // The reference's flight is that of its own robots.
        let (own, system) = (named(robot), named(&format!("{robot}-paper")));
        for (system, base, config) in [
            (&system, Base::Flight, ArticulatedConfig::paper(&system, Friction::Coulomb)),
            (&own, Base::ExactFlight, ArticulatedConfig::accurate(&own)),
        ] {
            let (mut ours, torques) = batch(system, "free", 5);
            let mut truth = ours.clone();
            run(&mut Neural::on_cpu(model(system, base), system), &mut ours, &torques, 30);
            run(&mut Articulated::new(config), &mut truth, &torques, 30);
            assert_eq!(ours.states, truth.states, "{robot}, {base:?}: {:.1e} apart", gap(&ours.states, &truth.states));
        }
        // And with a ground in reach the network does speak.
        let scene = if robot == "pendulum" { "ground1" } else { "ground" };
        let (mut ours, torques) = batch(&system, scene, 5);
        let mut truth = ours.clone();
        run(&mut learned(&system, Positions::Rotary), &mut ours, &torques, 60);
        run(&mut Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb)), &mut truth, &torques, 60);
        assert_ne!(ours.states, truth.states, "{robot} on {scene}: the network is never asked");
    }
}

#[test]
fn an_environment_is_that_environment_alone() {
    for positions in POSITIONS {
        let system = named("pendulum");
        let (first, torques) = batch(&system, "ground1", 6);
        let mut all = first.clone();
        run(&mut learned(&system, positions), &mut all, &torques, 25);
        for env in 0..6 {
            let mut alone = Batch::new(&system, &first.scenes[env], 1);
            alone.reset(0, first.state(env));
            run(&mut learned(&system, positions), &mut alone, &torques[2 * env..2 * env + 2], 25);
            let difference = gap(alone.state(0), all.state(env));
            assert!(difference < BOUND, "environment {env} of 6 and alone: {difference:.1e}");
        }
    }
}

#[test]
fn a_reset_forgets() {
    for positions in POSITIONS {
        let system = named("pendulum");
        let (first, torques) = batch(&system, "ground1", 3);
        let mut used = Simulation::new(first.clone(), learned(&system, positions));
        run(&mut *used.solver, &mut used.batch, &torques, 14);
        (0..3).for_each(|env| used.reset(env, first.state(env)));
        let mut fresh = Simulation::new(first, learned(&system, positions));
        run(&mut *used.solver, &mut used.batch, &torques, 14);
        run(&mut *fresh.solver, &mut fresh.batch, &torques, 14);
        let difference = gap(&used.batch.states, &fresh.batch.states);
        assert!(difference < BOUND, "reset against fresh: {difference:.1e}");
    }
}

/// What is learned of a frame leads back to its end, from whatever it is added to: f32 of a change of at most a few units.
#[test]
fn a_target_applied_is_the_next_state() {
    for robot in ["pendulum", "cartpole", "cube", "ant"] {
        let system = named(robot);
        let (robot_, d) = (&system.robot, system.robot.state_dim());
        for base in [Base::State, Base::Flight, Base::Draft(1)] {
            let mut features = Features::new(&system, base);
            let mut worst = 0.0f64;
            for k in 0..50 {
                let [state, from, next] = [0, 1, 2].map(|i| start(&system, Start::Sample, &mut stream(42, 3 * k + i)));
                let from = if base == Base::State { state.clone() } else { from };
                let (mut target, mut found) = (vec![0.0f32; d], vec![0.0; d]);
                features.target(&state, &from, &next, &mut target);
                let change: Vec<f64> = target.iter().map(|x| f64::from(*x)).collect();
                features.apply(&state, &from, &change, &mut found);
                let root = robot_.root_coords();
                for (i, (a, b)) in found.iter().zip(&next).enumerate() {
                    let wraps = (root..robot_.nq()).contains(&i) && robot_.joints().nth(i - root).is_some_and(|j| j.wraps());
                    worst = worst.max(if wraps { wrap(a - b).abs() } else { (a - b).abs() / b.abs().max(1.0) });
                }
            }
            println!("{robot} on {base:?}: {worst:.1e}");
            assert!(worst < 1e-5, "{robot} on {base:?}: {worst:.1e} from the next state, bound 1e-5");
        }
    }
}

/// The token of a state on flight, in a scene with one tilted plane, after the whole world is moved by `motion`.
fn token(robot: &str, motion: &Isometry3<f64>, k: u64) -> Vec<f32> {
    let mut system = (*named(robot)).clone();
    if let nerd_core::robot::Base::Fixed(pose) = &mut system.robot.base {
        *pose = motion * *pose;
    }
    let system = Arc::new(system);
    let (by, turn, nq) = (motion.translation.vector, motion.rotation, system.robot.nq());
    let mut state = start(&system, Start::Sample, &mut stream(43, k));
    if system.robot.floating() {
        let (p, r) = (vector(&state[..3]), quaternion(&state[3..7]));
        let (w, v) = (turn * vector(&state[nq..]), turn * vector(&state[nq + 3..]));
        state[..3].copy_from_slice((turn * p + by).as_slice());
        write_quaternion(&mut state[3..7], &(turn * r));
        state[nq..nq + 3].copy_from_slice(w.as_slice());
        // The twist is about the world's origin.
        state[nq + 3..nq + 6].copy_from_slice((v + by.cross(&w)).as_slice());
    }
    let (normal, offset) = (Vector3::new(0.1, 0.99, -0.1).normalize(), 0.6);
    let plane = Plane { normal: turn * normal, offset: offset + (turn * normal).dot(&by) };
    let mut scene = Scene::free(turn * system.gravity());
    scene.colliders.push(Collider::plane(plane, system.spec.material));
    let scene = Arc::new(scene);
    let torques: Vec<f64> = (0..system.robot.joint_count()).map(|i| 10.0 * (i as f64).sin()).collect();
    let mut flight = Base::Flight.flight(&system).expect("flies");
    let base = flight.step(&state, std::slice::from_ref(&scene), &torques).expect("a frame").to_vec();
    let mut events = Vec::new();
    contacts(&system, &scene, &state, &mut Data::new(&system.robot), &mut events);
    let mut out = vec![0.0; Features::inputs(&system, Base::Flight)];
    Features::new(&system, Base::Flight).token(&state, &base, &events, &torques, &scene.gravity, &mut out);
    out
}

#[test]
fn a_token_on_flight_sees_neither_place_nor_heading() {
    let up = Vector3::y_axis();
    for robot in ["pendulum", "ant"] {
        let mut seen = 0;
        for k in 0..20 {
            let here = token(robot, &Isometry3::identity(), k);
            let points = named(robot).robot.contact_points.len();
            let ways = named(robot).robot.state_dim() + 7 * points;
            seen += here[ways..ways + 3 * points].iter().filter(|x| **x != 0.0).count();
            for (by, heading) in [(Vector3::new(3.0, -1.0, 2.0), 0.0), (Vector3::zeros(), 2.0), (Vector3::new(300.0, 20.0, -500.0), -1.3)] {
                let there = token(robot, &Isometry3::from_parts(by.into(), UnitQuaternion::from_axis_angle(&up, heading)), k);
                let worst = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(worst < 1e-5, "{robot}, start {k}, moved {by:?} and turned {heading}: {worst:.1e}");
            }
        }
        assert!(seen > 0, "{robot}: no point was near enough for its way to be seen; the test shows nothing");
    }
}
