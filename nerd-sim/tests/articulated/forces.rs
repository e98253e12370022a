//! Contact forces at points, solvers that report none, and poses by name.

use nerd_sim::instruments::glide;

use super::common::*;

/// The cube, tilted, with its centre 0.15 m above the ground.
fn cube(config: fn(&System) -> ArticulatedConfig) -> Simulation {
    let system = built_in("cube");
    let mut start = system.default_state();
    let turn = nalgebra::UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1);
    start[..3].copy_from_slice((-system.gravity().normalize() * 0.15).as_slice());
    start[3..7].copy_from_slice(turn.coords.as_slice());
    Simulation::new(at(&system, "plane", &start), Articulated::new(config(&system)))
}

/// Newton's second law, `(sum F + m g) dt` is the change of momentum, over every frame of a fall, a landing and a rest.
/// Both presets update the mass matrix in every substep. Kept for a frame, as in `paper`, it does not conserve
/// momentum.
#[test]
fn forces_are_what_changes_momentum() {
    let presets: [fn(&System) -> ArticulatedConfig; 2] =
        [ArticulatedConfig::accurate, |_| ArticulatedConfig::explicit(64, Friction::Coulomb)];
    for preset in presets {
        let mut simulation = cube(preset);
        let system = simulation.batch.system.clone();
        let (m, dt, gravity) = (system.robot.mass(), system.frame_time, system.gravity());
        // The root's origin is the cube's centre of mass.
        assert!(system.robot.links[0].inertia.com.norm() < 1e-9);
        let momentum = |s: &[f64]| (vector(&s[10..]) + vector(&s[7..]).cross(&vector(s))) * m;
        let (mut touched, mut last, mut worst) = (0, Vector3::zeros(), 0.0f64);
        for _ in 0..400 {
            let before = momentum(simulation.batch.state(0));
            simulation.step(&[]).expect("a frame");
            let change = momentum(simulation.batch.state(0)) - before;
            last = simulation.batch.contact_force(0, "cube").expect("forces");
            worst = worst.max((change - (last + gravity * m) * dt).norm() / (m * 9.81 * dt).max(change.norm()));
            touched += usize::from(last.norm() > 0.0);
        }
        let weight = (last + gravity * m).norm() / (gravity * m).norm();
        assert!(worst < 0.02, "{:?}: forces are {worst} off what changes momentum", preset(&system));
        assert!(touched > 200 && weight < 0.02, "{touched} frames of contact, at rest {last:?}");
    }
}

#[test]
fn a_solver_without_forces_says_so_before_and_after() {
    let mut simulation = cube(ArticulatedConfig::accurate);
    assert!(simulation.solver.capabilities().forces);
    simulation.step(&[]).expect("a frame");
    assert!(line(simulation.batch.contact_force(0, "cub")).contains("near are `cube`"));
    // Forces of an earlier frame do not remain.
    simulation.solver = Box::new(Rapier::new(RapierConfig::default()));
    assert!(!simulation.solver.capabilities().forces);
    simulation.step(&[]).expect("a frame");
    assert!(line(simulation.batch.contact_force(0, "cube")).starts_with("no contact forces are known"));
    assert!(simulation.batch.forces_on(0).is_empty());
}

#[test]
fn a_batch_knows_names() {
    let system = built_in("ant");
    let mut batch = batch(&system, "ground", 2);
    let name = system.robot.joints().nth(3).expect("a joint").name.clone();
    batch.set_joint(1, &name, [0.2, -0.5]).expect("a joint");
    assert_eq!((batch.joint(1, &name).ok(), batch.joint(0, &name).ok()), (Some([0.2, -0.5]), Some([0.0; 2])));
    let pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.1, 0.2, 0.3));
    let moves = Motion::from_slice(&[0.3, 0.1, -0.2, 1.0, 0.5, 0.0]);
    batch.set_root(1, &pose, moves).expect("free");
    let [root, link] = [&system.robot.links[0].name, &system.robot.links.last().expect("a link").name];
    assert!((batch.pose(1, root).expect("a root").to_homogeneous() - pose.to_homogeneous()).amax() < 1e-14);
    assert!((batch.velocity(1, root).expect("a root").vector() - moves.vector()).amax() < 1e-14);
    // The last link's origin moves with the linear velocity reported for the link.
    let (before, v) = (batch.pose(1, link).expect("a link"), batch.velocity(1, link).expect("a link"));
    glide(&system, batch.state_mut(1), 1e-6);
    let went = (batch.pose(1, link).expect("a link").translation.vector - before.translation.vector) / 1e-6;
    assert!((went - v.lin).amax() < 1e-4, "{went} and {}", v.lin);
    assert!(batch.pose(0, "nobody").is_err());
    assert!(
        super::common::batch(&built_in("cartpole"), "free", 1).set_root(0, &pose, moves).is_err(),
        "a root that is bolted down"
    );
}
