//! Forces at contact points: weight, the impulse of a landing, friction, and who tells none.

use std::sync::Arc;

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
            last = simulation.batch.contact_force(0, "cube").expect("told");
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
fn who_tells_no_forces_says_so_before_and_after() {
    let (_, mut simulation) = cube(ArticulatedConfig::accurate);
    assert!(simulation.solver.capabilities().forces);
    simulation.step(&[]).expect("a frame");
    let force = |batch: &Batch, link: &str| batch.contact_force(0, link).map_err(|e| e.to_string());
    assert!(force(&simulation.batch, "cube").is_ok());
    assert!(force(&simulation.batch, "cub").is_err_and(|e| e.contains("near are `cube`")));
    // Those of a frame before are none of this one.
    simulation.solver = Box::new(Rapier::new(RapierConfig::default()));
    assert!(!simulation.solver.capabilities().forces);
    simulation.step(&[]).expect("a frame");
    assert!(force(&simulation.batch, "cube").is_err_and(|e| e.starts_with("no contact forces are known")));
    assert!(simulation.batch.forces_on(0).is_empty());
}

#[test]
fn a_batch_knows_names() {
    let system = System::named("ant").expect("built in");
    let mut batch = Batch::new(&system, &system.scene("ground").expect("ground"), 2);
    let name = system.robot.joints().nth(3).expect("a joint").name.clone();
    batch.set_joint(1, &name, [0.2, -0.5]).expect("a joint");
    assert_eq!((batch.joint(1, &name).ok(), batch.joint(0, &name).ok()), (Some([0.2, -0.5]), Some([0.0; 2])));
    let (pose, moves) =
        (Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.1, 0.2, 0.3)), Motion::from_slice(&[0.3, 0.1, -0.2, 1.0, 0.5, 0.0]));
    batch.set_root(1, &pose, moves).expect("free");
    let root = &system.robot.links[0].name;
    assert!((batch.pose(1, root).expect("a root").to_homogeneous() - pose.to_homogeneous()).amax() < 1e-14);
    assert!((batch.velocity(1, root).expect("a root").vector() - moves.vector()).amax() < 1e-14);
    // A point of the last link goes where its velocity leads.
    let link = &system.robot.links.last().expect("a link").name;
    let (before, v) = (batch.pose(1, link).expect("a link"), batch.velocity(1, link).expect("a link"));
    nerd_sim::instruments::glide(&system, batch.state_mut(1), 1e-6);
    let went = (batch.pose(1, link).expect("a link").translation.vector - before.translation.vector) / 1e-6;
    assert!((went - v.lin).amax() < 1e-4, "{went} and {}", v.lin);
    assert!(
        batch.pose(0, "nobody").is_err()
            && Batch::new(&System::named("cartpole").expect("built in"), &batch.scenes[0], 1).set_root(0, &pose, moves).is_err()
    );
}
