//! Three algorithms, one answer: forward dynamics by ABA, by the mass matrix (CRBA, dense and sparse factors) and by
//! inverse dynamics (RNEA) on random trees up to 30 joints.
//!
//! Bounds: the answers differ by rounding (1e-16) times the condition of the mass matrix (up to 1e5 here), hence
//! 1e-10 of the largest entry.

mod common;

use common::*;
use nalgebra::Vector3;
use nerd_core::dynamics::{Data, Factor, aba, bias, crba, kinematics, rnea, to_local, to_world};
use nerd_core::robot::{Base, Robot};

const BOUND: f64 = 1e-10;

fn accelerations(robot: &Robot, q: &[f64], qd: &[f64], tau: &[f64], data: &mut Data) -> Vec<f64> {
    kinematics(robot, q, data);
    assert!(aba(robot, qd, tau, &GRAVITY.into(), data));
    data.qdd.as_slice().to_vec()
}

#[test]
fn articulated_bodies_mass_matrix_and_inverse_dynamics_agree() {
    let gravity = Vector3::from(GRAVITY);
    let mut worst = [0.0f64; 3];
    for (robot, mut rng) in robots() {
        let (mut data, mut factor) = (Data::new(&robot), Factor::new(&robot));
        for pushed in [false, true] {
            let ((q, qd), tau) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 20.0));
            if pushed {
                push(&mut rng, &mut data);
            }
            let qdd = accelerations(&robot, &q, &qd, &tau, &mut data);

            bias(&robot, &qd, &gravity, &mut data);
            crba(&robot, &mut data);
            let rhs: Vec<f64> = tau.iter().zip(data.tau.iter()).map(|(t, c)| t - c).collect();
            worst[0] = worst[0].max(gap(&dense(&data.mass, rhs.iter().copied()), &qdd));
            let mut sparse = rhs;
            assert!(factor.refill(&data.mass));
            factor.solve(&mut sparse);
            worst[1] = worst[1].max(gap(&sparse, &qdd));

            rnea(&robot, &qd, &qdd, &gravity, &mut data);
            worst[2] = worst[2].max(gap(data.tau.as_slice(), &tau));
        }
    }
    println!("worst relative difference: dense {:.1e}, sparse {:.1e}, inverse {:.1e}", worst[0], worst[1], worst[2]);
    assert!(worst.iter().all(|w| *w < BOUND), "ABA against dense, sparse and inverse dynamics: {worst:?}, allowed {BOUND:.0e}");
}

#[test]
fn moving_the_base_100_km_changes_accelerations_by_rounding_only() {
    // A twist about the world origin holds w x p, 1e5 m/s here, to 1e-16 of itself: 1e-11 m/s of p_dot are lost.
    let mut worst = 0.0f64;
    for (mut robot, mut rng) in robots() {
        let ((mut q, qd), tau) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 20.0));
        let mut data = Data::new(&robot);
        let near = accelerations(&robot, &q, &qd, &tau, &mut data);
        let mut twist = qd;
        match &mut robot.base {
            Base::Fixed(pose) => pose.translation.vector += Vector3::new(1e5, -1e5, 1e5),
            Base::Floating => (0..3).for_each(|k| q[k] += 1e5),
        }
        to_world(&robot, &q, &mut twist);
        to_local(&robot, &q, &mut twist);
        worst = worst.max(gap(&accelerations(&robot, &q, &twist, &tau, &mut data), &near));
    }
    println!("100 km away: {worst:.1e}");
    assert!(worst < 1e-9, "100 km away accelerations differ by {worst:.1e} of the largest, allowed 1e-9");
}

#[test]
fn a_robot_let_go_at_rest_falls_with_gravity() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots().filter(|(r, _)| r.floating()) {
        let (q, rest) = (state(&mut rng, &robot).0, vec![0.0; robot.nv()]);
        let qdd = accelerations(&robot, &q, &rest, &rest, &mut Data::new(&robot));
        let mut falling = rest;
        falling[3..6].copy_from_slice(&GRAVITY);
        worst = worst.max(gap(&qdd, &falling));
    }
    println!("free fall: {worst:.1e}");
    assert!(worst < 1e-12, "free fall is off by {worst:.1e} of g, allowed 1e-12");
}

#[test]
fn without_inertia_there_is_no_answer() {
    let mut rng = Rng::seed_from_u64(0);
    let mut robot = robot(&mut rng, 3, false);
    for link in &mut robot.links {
        link.inertia = Default::default();
    }
    robot.joints_mut().for_each(|j| j.armature = 0.0);
    let (q, qd) = state(&mut rng, &robot);
    let (mut data, mut factor) = (Data::new(&robot), Factor::new(&robot));
    kinematics(&robot, &q, &mut data);
    assert!(!aba(&robot, &qd, &[0.0; 3], &GRAVITY.into(), &mut data), "ABA divided by no inertia");
    crba(&robot, &mut data);
    assert!(!factor.refill(&data.mass), "a zero mass matrix was factorised");
    assert!(factor.fault(&robot).contains("joint2"), "the last joint is the first to be missed: {}", factor.fault(&robot));
}

/// A root without mass turns in its child for nothing. Rounding leaves something on the diagonal, positive or not.
#[test]
fn a_massless_root_is_named() {
    for seed in 0..50 {
        let mut rng = Rng::seed_from_u64(seed);
        let mut robot = robot(&mut rng, 4, true);
        robot.links[0].inertia = Default::default();
        robot.joints_mut().for_each(|j| j.armature = 0.0);
        let (q, _) = state(&mut rng, &robot);
        let (mut data, mut factor) = (Data::new(&robot), Factor::new(&robot));
        kinematics(&robot, &q, &mut data);
        crba(&robot, &mut data);
        if robot.links.iter().filter(|l| l.parent == Some(0)).count() == 1 {
            assert!(!factor.refill(&data.mass), "seed {seed}: a singular mass matrix was factorised");
            assert!(factor.fault(&robot).contains("`root`"), "{}", factor.fault(&robot));
        }
    }
}
