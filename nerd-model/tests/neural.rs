//! The learned solver as a solver: windows grow, end at a reset and at a gap; the network sees neither where nor which way
//! the robot stands. Weights are random: none of this is learned. Bound: f32 rounding, since a window's arithmetic may
//! be cut in other chunks.

mod common;

use std::sync::Arc;

use common::{POSITIONS, gap, model};
use nalgebra::{UnitQuaternion, Vector3};
use nerd_core::contact::ContactEvent;
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::folder::Model;
use nerd_model::neural::Neural;
use nerd_model::transformer::{Positions, Storage};
use nerd_sim::prelude::*;

const BOUND: f64 = 1e-5;

fn simulation(scene: &str, n: usize, positions: Positions) -> Simulation {
    let system = System::named("pendulum").expect("built in");
    let mut batch = Batch::new(&system, &system.scene(scene).expect("scene"), n);
    batch.states.iter_mut().enumerate().for_each(|(i, x)| *x = (0.7 * i as f64).sin());
    Simulation::new(batch, Neural::on_cpu(common::placed(&system, Base::State, positions), &system))
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
        let mut continued = simulation("ground1", 3, positions);
        run(&mut continued, 14);
        all.reset(1, &state);
        let mut fresh = simulation("ground1", 1, positions);
        fresh.reset(0, &state);
        run(&mut all, 12);
        run(&mut fresh, 12);
        run(&mut continued, 12);
        run(&mut undisturbed, 26);
        let difference = gap(all.batch.state(1), fresh.batch.state(0));
        assert!(difference < BOUND, "reset against fresh: {difference:.1e}");
        let difference = gap(all.batch.state(2), undisturbed.batch.state(2));
        assert!(difference < BOUND, "the neighbour noticed: {difference:.1e}");
        let difference = gap(all.batch.state(1), continued.batch.state(1));
        assert!(difference > 10.0 * BOUND, "with and without history alike ({difference:.1e}): the network sees no history");
    }
}

#[test]
fn frames_of_another_solver_in_between_empty_the_window() {
    for positions in POSITIONS {
        let mut swapped = simulation("ground1", 2, positions);
        let system = swapped.batch.system.clone();
        run(&mut swapped, 8);
        let mut truth: Box<dyn Solver> = Box::new(Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb)));
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

#[test]
fn a_model_of_another_robot_or_truth_is_refused_by_name() {
    let (pendulum, cartpole) = (System::named("pendulum").expect("built in"), System::named("cartpole").expect("built in"));
    let folder = tempfile::tempdir().expect("temporary folder");
    model(&pendulum, Base::State).save(folder.path(), "# card\n", Storage::F32).expect("saved");
    let loaded = Model::load(folder.path(), &pendulum, Some("articulated accurate")).expect("its own");
    assert_eq!(loaded.weights.flat, model(&pendulum, Base::State).weights.flat);
    let refusal = |system: &System, truth| Model::load(folder.path(), system, truth).expect_err("refused").to_string();
    let error = refusal(&cartpole, None);
    assert!(error.contains("`pendulum`") && error.contains("`cartpole`") && !error.contains('\n'), "{error}");
    let error = refusal(&pendulum, Some("rapier"));
    assert!(error.contains("`articulated accurate`") && error.contains("`rapier`"), "{error}");
    std::fs::write(folder.path().join("model.safetensors"), b"short").expect("written");
    assert!(refusal(&pendulum, None).contains("model.safetensors"));
}

#[test]
fn a_scene_that_is_no_scene_is_refused_for_its_environment_alone() {
    let mut simulation = simulation("ground1", 3, Positions::Rotary);
    let mut whole = self::simulation("ground1", 3, Positions::Rotary);
    run(&mut simulation, 4);
    run(&mut whole, 5);
    let mut scene = (*simulation.batch.scenes[1]).clone();
    scene.colliders[0].plane.as_mut().expect("a plane").offset = f64::NAN;
    simulation.batch.scenes[1] = Arc::new(scene);
    let faults = simulation.step(&[3.0; 6]).expect_err("a plane nowhere").faults().expect("of environments");
    assert_eq!(faults.iter().map(|f| (f.env, f.frame)).collect::<Vec<_>>(), [(1, 4)]);
    assert!(faults[0].reason.contains("plane"), "{}", faults[0].reason);
    for env in [0, 2] {
        let difference = gap(simulation.batch.state(env), whole.batch.state(env));
        assert!(difference < BOUND, "environment {env} noticed: {difference:.1e}");
    }
}

const CUBE: &str = r#"<robot name="cube"><link name="cube"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.3"/></inertial></link></robot>"#;
const SPEC: &str = r#"
urdf = "cube.urdf"
floating = true
frame_time = "1/60"
gravity = [0.0, 0.0, -9.81]
substeps = 4
state_columns = ["px", "py", "pz", "qx", "qy", "qz", "qw", "wx", "wy", "wz", "vx", "vy", "vz"]
torque_columns = []
[[contact]]
link = "cube"
point = [0.2, 0.2, -0.2]
radius = 0.0
thickness = 0.05
"#;

/// A state with root at `p`, turned by `turn` about the vertical, all else equal in its own frame.
fn placed(p: Vector3<f64>, turn: f64) -> (Vec<f64>, UnitQuaternion<f64>) {
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    let r = heading * UnitQuaternion::from_euler_angles(0.3, -0.4, 0.0);
    let (w, p_dot) = (heading * Vector3::new(0.5, -1.0, 2.0), heading * Vector3::new(1.0, 2.0, -0.5));
    let v = p_dot + p.cross(&w);
    let (c, mut state) = (r.coords, p.as_slice().to_vec());
    state.extend([c.x, c.y, c.z, c.w]);
    state.extend(w.iter().chain(v.iter()));
    (state, heading)
}

#[test]
fn the_network_sees_neither_place_nor_heading() {
    let system = Arc::new(System::from_text("cube", CUBE, Some(SPEC)).expect("valid"));
    let mut features = Features::new(&system, Base::State);
    let mut token = |p: Vector3<f64>, turn: f64| {
        let (state, heading) = placed(p, turn);
        let event =
            ContactEvent { p0: p, p1: p + heading * Vector3::new(0.2, 0.1, -0.3), normal: Vector3::z(), distance: 0.05, collider: 0 };
        let mut out = vec![0.0; Features::inputs(&system, Base::State)];
        features.token(&state, &state, &[event], &[], &Vector3::new(0.0, 0.0, -9.81), &mut out);
        let mut change = vec![0.0; Features::outputs(&system)];
        let (next, _) = placed(p + heading * Vector3::new(0.01, 0.02, 0.0), turn + 0.03);
        features.target(&state, &state, &next, &mut change);
        [out, change].concat()
    };
    let here = token(Vector3::zeros(), 0.0);
    for (distance, bound) in [(1.0, 1e-6), (1e3, 1e-6), (1e5, 1e-5)] {
        let there = token(Vector3::new(distance, -distance, 0.3 * distance), 2.5);
        let worst = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("{distance} m away, turned: {worst:.1e}");
        assert!(f64::from(worst) < bound, "{distance} m away and turned, the network sees a difference of {worst:.1e}");
    }
}
