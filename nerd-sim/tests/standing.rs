//! A robot of which no material is said stands: its feet stick as Coulomb's law has it. Regularised, they creep by the
//! force on a foot over the material's tangential damping, 1 mm in 5 s for 30 N.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::state::{vector, write_quaternion};
use nerd_sim::control::Controller;
use nerd_sim::prelude::*;

/// ANYmal in its pose, of the default material, z up, with gains that carry it.
fn quadruped() -> Arc<System> {
    let mut system = (*System::named("anymal").expect("built in")).clone();
    system.spec.material = Material::default();
    system.spec.gravity = [0.0, 0.0, -9.81];
    system.spec.joints.iter_mut().for_each(|j| (j.kp, j.kd) = (1500.0, 40.0));
    Arc::new(system)
}

/// Place and height of the base after every frame under its position law, pushed by gravity's part `aside` (m/s^2) after 1 s.
fn stand(config: ArticulatedConfig, aside: f64, seconds: usize) -> Vec<Vector3<f64>> {
    let system = quadruped();
    let mut batch = Batch::new(&system, &system.scene("plane").expect("a plane"), 1);
    let mut state = system.default_state();
    (state[0], state[1], state[2]) = (0.0, 0.0, 0.6);
    write_quaternion(&mut state[3..7], &nalgebra::UnitQuaternion::identity());
    batch.reset(0, &state);
    let (mut controller, mut solver) = (Controller::new(&system), Articulated::new(config));
    let (mut tau, still) = (vec![0.0; 12], vec![0.0; 12]);
    let mut path = Vec::new();
    for frame in 0..60 * seconds {
        if frame == 60 && aside != 0.0 {
            let mut pushed = (*batch.scenes[0]).clone();
            pushed.gravity.x = aside;
            batch.scenes[0] = Arc::new(pushed);
        }
        controller.torques(batch.state(0), &still, &mut tau);
        solver.step(&mut batch, &tau).expect("finite");
        path.push(vector(batch.state(0)));
    }
    path
}

#[test]
fn a_standing_quadruped_holds_its_height() {
    for substeps in [4, 32] {
        let path = stand(ArticulatedConfig::implicit(substeps, Friction::Coulomb), 0.0, 6);
        // The first second is the landing.
        let heights: Vec<f64> = path[60..].iter().map(|p| p.z).collect();
        let (low, high) = heights.iter().fold((f64::MAX, f64::MIN), |(a, b), z| (a.min(*z), b.max(*z)));
        println!("x{substeps}: from {high:.4} to {low:.4} m in 5 s");
        assert!(low > 0.6 && high - low < 5e-3, "implicit x{substeps}: its base sinks from {high} to {low} m in 5 s, allowed 5 mm");
    }
}

/// The default friction is 0.5: 1.5 m/s^2 to the side are a third of what holds.
#[test]
fn a_push_below_the_friction_does_not_move_it() {
    for substeps in [4, 32] {
        let path = stand(ArticulatedConfig::implicit(substeps, Friction::Coulomb), 1.5, 6);
        // What the legs give way is a matter of their gains; it must come to an end.
        let (early, late) = (path[180], path[359]);
        let slid = (late - early).norm();
        println!("x{substeps}: {slid:.4} m in 3 s under {:.0} N", 1.5 * 53.2);
        assert!(slid < 5e-3, "implicit x{substeps}: pushed aside it slides by {slid} m in 3 s, allowed 5 mm");
    }
}

/// Explicit substeps are too long for so stiff a friction: they only tremble about rest, and let the robot sink. Its frames are
/// stepped implicitly.
#[test]
fn explicit_substeps_bear_the_default_material() {
    for (name, config) in [
        ("paper", ArticulatedConfig::paper(&quadruped(), Friction::Coulomb)),
        ("explicit x16", ArticulatedConfig::explicit(16, Friction::Coulomb)),
        ("explicit x64", ArticulatedConfig::explicit(64, Friction::Huber)),
    ] {
        let path = stand(config, 0.0, 6);
        let (low, high) = path[60..].iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.z), b.max(p.z)));
        let aside = path.iter().map(|p| p.xy().norm()).fold(0.0, f64::max);
        println!("{name}: from {high:.4} to {low:.4} m, {aside:.4} m aside");
        assert!(low > 0.6 && high - low < 5e-3 && aside < 0.05, "{name}: its base sinks from {high} to {low} m, {aside} m aside");
    }
}
