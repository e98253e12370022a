//! Dynamics with mimic joints equal the dynamics of all joints as independent, projected onto the coordinates.

use super::common::*;

/// The robot with all joints independent, and `G`, `o` of `q_all = G q + o`, `qd_all = G qd`.
fn unfolded(robot: &Robot) -> (Robot, DMatrix<f64>, DVector<f64>) {
    let mut all = robot.clone();
    (0..all.links.len()).for_each(|link| all.follow(link, None));
    let (mut g, mut o) = (DMatrix::zeros(all.nv(), robot.nv()), DVector::zeros(all.nv()));
    (0..robot.root_dofs()).for_each(|k| g[(k, k)] = 1.0);
    for (link, (one, many)) in robot.links.iter().zip(robot.dofs().into_iter().zip(all.dofs())) {
        let Some(joint) = &link.joint else { continue };
        g[(many, one)] = joint.ratio();
        o[many] = joint.mimic().map_or(0.0, |m| m.offset);
    }
    (all, g, o)
}

#[test]
fn the_dynamics_are_those_of_all_joints_folded() {
    let mut followers = 0;
    for (robot, mut rng) in robots() {
        let robot = following(&mut rng, &robot);
        let (all, g, o) = unfolded(&robot);
        followers += all.nv() - robot.nv();
        let ((q, qd), qdd) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 2.0));
        let (dofs, coords, joints) = (robot.root_dofs(), robot.root_coords(), all.joint_count());
        let folded = g.view((dofs, dofs), (joints, robot.joint_count())) * DVector::from_column_slice(&q[coords..]);
        let q_all = [&q[..coords], (folded + o.rows(dofs, joints)).as_slice()].concat();
        let spread = |x: &[f64]| (&g * DVector::from_column_slice(x)).as_slice().to_vec();
        let qd_all = LocalVelocity(spread(&qd.0));
        let (mut one, mut many) = (Data::new(&robot), Data::new(&all));
        push(&mut rng, &mut one);
        many.external = one.external.clone();
        let tau = one.inverse_dynamics(&robot, &q, &qd, &qdd, &GRAVITY).clone();
        let folded = g.transpose() * many.inverse_dynamics(&all, &q_all, &qd_all, &spread(&qdd), &GRAVITY);
        let apart = (&tau - &folded).amax() / folded.amax();
        assert!(apart < 1e-12, "inverse dynamics of {} coordinates: {apart:.1e} off", robot.nv());
        let mass = g.transpose() * many.mass_matrix(&all, &q_all) * &g;
        let apart = (one.mass_matrix(&robot, &q) - &mass).amax() / mass.amax();
        assert!(apart < 1e-12, "mass matrix: {apart:.1e} off");
        // Forward dynamics inverts inverse dynamics.
        let back = one.forward_dynamics(&robot, &q, &qd, tau.as_slice(), &GRAVITY).expect("inertia");
        let apart = back.iter().zip(&qdd).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "forward dynamics of {} coordinates: {apart:.1e} off", robot.nv());
        let a = totals(&robot, &whole(&robot, &q, &qd), &mut one);
        let b = totals(&all, &whole(&all, &q_all, &qd_all), &mut many);
        assert!(
            (a.kinetic - b.kinetic).abs() < 1e-10 * b.kinetic,
            "kinetic energy {} J, of all joints {} J",
            a.kinetic,
            b.kinetic
        );
    }
    assert!(followers > 40, "{followers} joints that follow");
}
