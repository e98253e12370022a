//! Coulomb friction with sticking: bodies that stick do not creep, bodies that slide accelerate by Coulomb's law.

use nalgebra::{UnitQuaternion, Vector3};

use crate::common::*;

/// The scene `ground` with its gravity rotated by an angle (rad) about x.
fn leaning(system: &System, angle: f64) -> Arc<Scene> {
    let mut scene = (*system.scene("ground").expect("level")).clone();
    scene.gravity = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), angle) * scene.gravity;
    Arc::new(scene)
}

/// The shipped cube on its face, with its state and its friction coefficient.
fn cube() -> (Arc<System>, Vec<f64>, f64) {
    let system = built_in("cube");
    let mu = system.scene("ground").expect("level").colliders[0].material.mean(&system.spec.material).friction;
    let mut state = system.default_state();
    let half = system.robot.contact_points.iter().map(|p| p.local.z.abs() + p.radius).fold(0.0, f64::max);
    state[..7].copy_from_slice(&[0.0, 0.0, half, 0.0, 0.0, 0.0, 1.0]);
    (system, state, mu)
}

/// Distance (m) across the ground and rotation (rad) about its normal, from one state of a free root to another.
fn moved(from: &[f64], to: &[f64]) -> (f64, f64) {
    let turn = |q: &[f64]| UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q[6], q[3], q[4], q[5]));
    let by = turn(to) * turn(from).inverse();
    ((to[0] - from[0]).hypot(to[1] - from[1]), by.euler_angles().2.abs())
}

/// A cube on its face at 60 % of its friction angle.
#[test]
fn a_cube_below_its_friction_angle_does_not_creep() {
    let (system, mut state, mu) = cube();
    for substeps in [1, 4] {
        let mut batch = within(&system, &leaning(&system, 0.6 * mu.atan()), &state);
        let mut solver = implicit(substeps);
        let frames = |time: f64| (time / system.frame_time) as usize;
        run(&mut solver, &mut batch, 0.0, frames(2.0));
        state.copy_from_slice(batch.state(0));
        run(&mut solver, &mut batch, 0.0, frames(60.0));
        let (way, turn) = moved(&state, batch.state(0));
        assert!(way < 1e-4 && turn < 1e-4, "x{substeps}: {way:.1e} m and {turn:.1e} rad in a minute");
    }
}

/// On a steeper gradient the cube accelerates by `g (sin a - mu cos a)`.
#[test]
fn a_cube_above_its_friction_angle_slides_by_coulombs_law() {
    let (system, state, mu) = cube();
    for substeps in [1, 4] {
        for times in [1.3, 2.0, 4.0] {
            let angle = times * mu.atan();
            let mut batch = within(&system, &leaning(&system, angle), &state);
            let mut solver = implicit(substeps);
            let frames = |time: f64| (time / system.frame_time).round() as usize;
            run(&mut solver, &mut batch, 0.0, frames(0.5));
            let begun = batch.state(0).to_vec();
            let nq = system.robot.nq();
            let v = (vector(&begun[nq + 3..]) + vector(&begun[nq..]).cross(&vector(&begun))).norm();
            run(&mut solver, &mut batch, 0.0, frames(1.0));
            let g = batch.scenes[0].gravity.norm();
            let way = (vector(batch.state(0)) - vector(&begun)).norm();
            let right = v + 0.5 * g * (angle.sin() - mu * angle.cos());
            assert!((way / right - 1.0).abs() < 0.01, "x{substeps}, {times} times the angle: {way} m for {right} m");
        }
    }
}

/// An ANYmal that stands by gains that carry it, on ground inclined by 5 degrees.
#[test]
fn a_standing_anymal_does_not_creep() {
    for substeps in [1, 4] {
        let mut system = (*built_in("anymal")).clone();
        system.spec.joints.iter_mut().for_each(|j| (j.kp, j.kd) = (1500.0, 40.0));
        let system = Arc::new(system);
        let level = system.scene("ground").expect("level");
        let mut scene = (*level).clone();
        scene.gravity = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), 0.09) * scene.gravity;
        let mut state = system.default_state();
        let mut batch = within(&system, &level, &state);
        batch.scenes[0] = Arc::new(scene);
        let (mut controller, mut solver) = (Controller::new(&system), implicit(substeps));
        let (mut tau, still) = (vec![0.0; 12], vec![0.0; 12]);
        let frames = |time: f64| (time / system.frame_time).round() as usize;
        let mut stand = |batch: &mut Batch, time: f64| {
            for _ in 0..frames(time) {
                controller.torques(batch.state(0), &still, &mut tau);
                solver.step(batch, &tau).expect("finite");
            }
        };
        stand(&mut batch, 10.0);
        state.copy_from_slice(batch.state(0));
        stand(&mut batch, 60.0);
        let way = (vector(batch.state(0)) - vector(&state)).norm();
        let turn = |q: &[f64]| UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q[6], q[3], q[4], q[5]));
        let turned = turn(&state).angle_to(&turn(batch.state(0)));
        assert!(way < 1e-5 && turned < 1e-5, "x{substeps}: {way:.1e} m and {turned:.1e} rad in a minute");
    }
}

/// From rest, on gradients just above the friction angle, sticking contacts let go.
#[test]
fn a_cube_breaks_away_at_its_friction_angle() {
    let (system, state, mu) = cube();
    for substeps in [1, 4] {
        let frames = |time: f64| (time / system.frame_time).round() as usize;
        let mut solver = implicit(substeps);
        let mut level = within(&system, &leaning(&system, 0.6 * mu.atan()), &state);
        run(&mut solver, &mut level, 0.0, frames(1.0));
        for times in [1.05, 1.1, 2.0] {
            let angle = (times * mu).atan();
            let mut batch = within(&system, &leaning(&system, angle), level.state(0));
            run(&mut solver, &mut batch, 0.0, frames(2.0));
            let rate = batch.scenes[0].gravity.norm() * (angle.sin() - mu * angle.cos());
            let way = (vector(batch.state(0)) - vector(level.state(0))).norm();
            let right = 0.5 * rate * 4.0;
            assert!((way / right - 1.0).abs() < 0.01, "x{substeps}, {times} times: {way} m for {right} m");
        }
    }
}
