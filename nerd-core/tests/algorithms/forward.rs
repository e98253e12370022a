//! Three algorithms, one answer: forward dynamics by ABA, by the mass matrix (CRBA, dense and sparse factors) and by
//! inverse dynamics (RNEA) on random trees up to 30 joints.
//!
//! Bounds: the answers differ by rounding (1e-16) times the condition of the mass matrix (up to 1e5 here), hence
//! 1e-10 of the largest entry.

use super::common::*;
use nerd_core::dynamics::{Factor, crba, kinematics};
use nerd_core::prelude::*;

const BOUND: f64 = 1e-10;

fn accelerations(robot: &Robot, q: &[f64], qd: &LocalVelocity<Vec<f64>>, tau: &[f64]) -> Vec<f64> {
    Data::new(robot).forward_dynamics(robot, q, qd, tau, &GRAVITY).expect("inertia").as_slice().to_vec()
}

#[test]
fn articulated_bodies_mass_matrix_and_inverse_dynamics_agree() {
    let mut worst = [0.0f64; 3];
    for (robot, mut rng) in robots() {
        let (mut data, mut factor) = (Data::new(&robot), Factor::new(&robot));
        for pushed in [false, true] {
            let ((q, qd), tau) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 20.0));
            if pushed {
                push(&mut rng, &mut data);
            }
            let qdd = data.forward_dynamics(&robot, &q, &qd, &tau, &GRAVITY).expect("inertia").clone();
            let bias = data.bias(&robot, &q, &qd, &GRAVITY);
            let mut x: Vec<f64> = tau.iter().zip(bias.iter()).map(|(t, c)| t - c).collect();
            let mass = data.mass_matrix(&robot, &q);
            worst[0] = worst[0].max(gap(&dense(mass, &x), qdd.as_slice()));
            assert!(factor.refill(mass));
            factor.solve(&mut x);
            worst[1] = worst[1].max(gap(&x, qdd.as_slice()));
            let back = data.inverse_dynamics(&robot, &q, &qd, qdd.as_slice(), &GRAVITY);
            worst[2] = worst[2].max(gap(back.as_slice(), &tau));
        }
    }
    println!("worst relative difference: dense {:.1e}, sparse {:.1e}, inverse {:.1e}", worst[0], worst[1], worst[2]);
    assert!(worst.iter().all(|w| *w < BOUND), "ABA against dense, sparse and inverse dynamics: {worst:?}, allowed {BOUND:.0e}");
}

/// What was asked before, of other coordinates, changes no answer.
#[test]
fn answers_are_of_the_coordinates_given() {
    for (robot, mut rng) in robots() {
        let ((q, qd), (other, faster)) = (state(&mut rng, &robot), state(&mut rng, &robot));
        let (tau, frame) = (values(&mut rng, robot.nv(), 20.0), robot.frame(&robot.links[0].name).expect("a link"));
        let all = |data: &mut Data, before: bool| {
            let mut out = Vec::new();
            let mut take = |x: &[f64]| out.extend_from_slice(x);
            for ask in 0..6 {
                if before {
                    data.jacobian_rate(&robot, &other, &faster, &frame, Axes::Local);
                    data.forward_dynamics(&robot, &other, &faster, &tau, &GRAVITY).expect("inertia");
                }
                match ask {
                    0 => take(data.mass_matrix(&robot, &q).as_slice()),
                    1 => take(data.gravity_torque(&robot, &q, &GRAVITY).as_slice()),
                    2 => take(data.bias(&robot, &q, &qd, &GRAVITY).as_slice()),
                    3 => take(data.forward_dynamics(&robot, &q, &qd, &tau, &GRAVITY).expect("inertia").as_slice()),
                    4 => take(data.jacobian(&robot, &q, &frame, Axes::World).as_slice()),
                    _ => take(data.jacobian_rate(&robot, &q, &qd, &frame, Axes::World).as_slice()),
                }
            }
            out
        };
        assert_eq!(all(&mut Data::new(&robot), false), all(&mut Data::new(&robot), true), "{} DoF", robot.nv());
    }
}

#[test]
fn moving_the_base_100_km_changes_accelerations_by_rounding_only() {
    // A twist about the world origin holds w x p, 1e5 m/s here, to 1e-16 of itself: 1e-11 m/s of p_dot are lost.
    let mut worst = 0.0f64;
    for (mut robot, mut rng) in robots() {
        let ((mut q, qd), tau) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 20.0));
        let near = accelerations(&robot, &q, &qd, &tau);
        match &mut robot.base {
            Base::Fixed(pose) => pose.translation.vector += Vector3::new(1e5, -1e5, 1e5),
            Base::Floating => (0..3).for_each(|k| q[k] += 1e5),
        }
        let far = qd.into_twist(&robot, &q).into_local(&robot, &q);
        worst = worst.max(gap(&accelerations(&robot, &q, &far, &tau), &near));
    }
    println!("100 km away: {worst:.1e}");
    assert!(worst < 1e-9, "100 km away accelerations differ by {worst:.1e} of the largest, allowed 1e-9");
}

#[test]
fn a_robot_let_go_at_rest_falls_with_gravity() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots().filter(|(r, _)| r.floating()) {
        let (q, rest) = (state(&mut rng, &robot).0, vec![0.0; robot.nv()]);
        let qdd = accelerations(&robot, &q, &LocalVelocity(rest.clone()), &rest);
        let mut falling = rest;
        falling[3..6].copy_from_slice(GRAVITY.as_slice());
        worst = worst.max(gap(&qdd, &falling));
    }
    println!("free fall: {worst:.1e}");
    assert!(worst < 1e-12, "free fall is off by {worst:.1e} of g, allowed 1e-12");
}

#[test]
fn without_inertia_there_is_no_answer_but_a_name() {
    let mut rng = Rng::seed_from_u64(0);
    let mut robot = robot(&mut rng, 3, false);
    robot.links.iter_mut().for_each(|link| link.inertia = Default::default());
    robot.joints_mut().for_each(|j| j.armature = 0.0);
    let (q, qd) = state(&mut rng, &robot);
    let error = Data::new(&robot).forward_dynamics(&robot, &q, &qd, &[0.0; 3], &GRAVITY).expect_err("no inertia").to_string();
    assert!(error.contains("joint2"), "the last joint is the first to be missed: {error}");
}

/// A root without mass turns in its child for nothing. Rounding leaves something on the diagonal, positive or not.
#[test]
fn a_massless_root_is_named() {
    for seed in 0..50 {
        let mut rng = Rng::seed_from_u64(seed);
        let mut robot = robot(&mut rng, 4, true);
        robot.links[0].inertia = Default::default();
        robot.joints_mut().for_each(|j| j.armature = 0.0);
        let (mut data, mut factor) = (Data::new(&robot), Factor::new(&robot));
        kinematics(&robot, &state(&mut rng, &robot).0, &mut data);
        crba(&robot, &mut data);
        if robot.links.iter().filter(|l| l.parent == Some(0)).count() == 1 {
            assert!(!factor.refill(&data.mass), "seed {seed}: a singular mass matrix was factorised");
            assert!(factor.fault(&robot).contains("`root`"), "{}", factor.fault(&robot));
        }
    }
}
