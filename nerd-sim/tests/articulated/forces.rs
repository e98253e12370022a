//! Forces at contact points: weight, the impulse of a landing, friction, and who tells none.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_sim::prelude::*;

fn cube(config: fn(&System) -> ArticulatedConfig) -> (Arc<System>, Simulation) {
    let system = System::named("cube").expect("built in");
    let mut batch = Batch::new(&system, &system.scene("plane").expect("plane"), 1);
    let mut start = system.default_state();
    // A little askew, a short way up.
    let turn = nalgebra::UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1);
    start[..3].copy_from_slice((-system.gravity().normalize() * 0.15).as_slice());
    start[3..7].copy_from_slice(turn.coords.as_slice());
    batch.reset(0, &start);
    batch.watch();
    let solver = Articulated::new(config(&system));
    (system, Simulation::new(batch, solver))
}

fn momentum(system: &System, state: &[f64]) -> Vector3<f64> {
    let v = |k: usize| Vector3::new(state[k], state[k + 1], state[k + 2]);
    (v(10) + v(7).cross(&v(0))) * system.robot.mass()
}

/// Newton's second law over every frame of a fall, a landing and a rest: the change of momentum is `(sum F + m g) dt`.
/// The mass matrix is renewed in every substep; one that is kept for a frame, as `paper` keeps it, does not keep momentum.
#[test]
fn forces_are_what_changes_momentum() {
    let presets: [fn(&System) -> ArticulatedConfig; 2] =
        [ArticulatedConfig::accurate, |_| ArticulatedConfig::explicit(64, Friction::Coulomb)];
    for preset in presets {
        let (system, mut simulation) = cube(preset);
        // The momentum above is that of the root's origin; the cube's centre of mass is there.
        assert!(system.robot.links[0].inertia.com.norm() < 1e-9);
        let (m, dt, mut touched, mut last) = (system.robot.mass(), system.frame_time, 0, Vector3::zeros());
        for frame in 0..400 {
            let before = momentum(&system, simulation.batch.state(0));
            simulation.step(&[]).expect("it can be stepped");
            let change = momentum(&system, simulation.batch.state(0)) - before;
            last = simulation.batch.force_on(0, 0);
            let expected = (last + system.gravity() * m) * dt;
            let off = (change - expected).norm() / (m * 9.81 * dt).max(change.norm());
            assert!(off < 0.02, "{:?}, frame {frame}: momentum changed by {change:?}, forces say {expected:?}", preset(&system));
            touched += usize::from(last.norm() > 0.0);
        }
        assert!(touched > 200, "it touched in {touched} frames only");
        let weight = -system.gravity() * m;
        assert!((last - weight).norm() < 0.02 * weight.norm(), "at rest {last:?}, its weight is {weight:?}");
    }
}

#[test]
fn who_tells_no_forces_says_so() {
    let (_, simulation) = cube(ArticulatedConfig::accurate);
    let mut batch = simulation.batch;
    let said = Rapier::new(RapierConfig::default()).step(&mut batch, &[]).expect_err("rapier tells none").to_string();
    assert!(said.contains("tells no contact forces"), "{said}");
    batch.forces.pop();
    let said = Articulated::new(ArticulatedConfig::converged(Friction::Coulomb)).step(&mut batch, &[]).expect_err("too few").to_string();
    assert!(said.contains("`forces`"), "{said}");
    // Nobody asks, nothing is told.
    batch.forces.clear();
    assert!(batch.forces_on(0).is_empty());
}
