//! Gravity compensation, and armature and damping of a floating root, against external wrenches and the mass matrix.

use super::common::*;
use nerd_core::dynamics::crba;

/// Gravity compensation equals an upward force at the compensated mass. A floating root's damping equals a wrench at
/// its frame.
#[test]
fn lifted_mass_and_a_damped_root_are_wrenches_on_their_links() {
    for (robot, mut rng) in robots() {
        let mut own = robot.clone();
        lifted(&mut rng, &mut own);
        let mut plain = own.clone();
        plain.free.damping = 0.0;
        plain.links.iter_mut().for_each(|link| link.lifted = PointMass::default());
        let ((q, qd), qdd) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 2.0));
        let mut data = Data::new(&own);
        let found = data.inverse_dynamics(&own, &q, &qd, &qdd, &GRAVITY).clone();
        for (k, link) in own.links.iter().enumerate() {
            let at = data.position[k] + data.rotation[k] * link.lifted.at;
            data.external[k] = Wrench::force_at(GRAVITY * -link.lifted.mass, &at);
        }
        if own.floating() {
            let (d, v) = (own.free.damping, data.velocity[0]);
            data.external[0] = data.external[0] - Wrench::new(v.ang * d, v.lin * d);
        }
        let expected = data.inverse_dynamics(&plain, &q, &qd, &qdd, &GRAVITY);
        let apart = (&found - expected).amax() / expected.amax();
        assert!(apart < 1e-12, "{} DoF: torques are {apart:.1e} off", robot.nv());
    }
}

/// Armature of a floating root adds to the diagonal of the mass matrix, and has no weight.
#[test]
fn armature_of_a_free_root_is_on_the_diagonal() {
    for (robot, mut rng) in robots().filter(|(robot, _)| robot.floating()) {
        let mut own = robot.clone();
        own.links[0].arm(0.3);
        let (q, qd) = state(&mut rng, &robot);
        let rest = LocalVelocity(vec![0.0; qd.0.len()]);
        let [mut with, mut without] = [&own, &robot].map(|robot| {
            let mut data = Data::new(robot);
            kinematics(robot, &q, &mut data);
            crba(robot, &mut data);
            data
        });
        (0..6).for_each(|k| without.mass[(k, k)] += 0.3);
        assert!((&with.mass - &without.mass).amax() < 1e-12, "{:.1e} off", (&with.mass - &without.mass).amax());
        let weight = with.bias(&own, &q, &rest, &GRAVITY) - without.bias(&robot, &q, &rest, &GRAVITY);
        assert!(weight.amax() < 1e-12, "it weighs {:.1e} N", weight.amax());
    }
}
