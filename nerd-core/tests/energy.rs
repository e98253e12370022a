//! The dynamics are those of one kinetic and one potential energy, which are computed here from link poses and twists.
//!
//! Bounds: polarisation of the (quadratic) kinetic energy is exact, rounding only; a central difference with step h
//! errs by h^2 times the third derivative and by 1e-16 E / h, both about 1e-8 of the largest term at h = 1e-5.

mod common;

use common::*;
use nalgebra::{DMatrix, Vector3};
use nerd_core::dynamics::{Data, aba, bias, crba, kinematics, point_position, velocities};
use nerd_core::state::vector;

const H: f64 = 1e-5;

#[test]
fn link_points_move_as_their_twists_say() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots() {
        let ((q, qd), local, mut data) = (state(&mut rng, &robot), vector3(&mut rng, 0.5), Data::new(&robot));
        let [ahead, behind] = [H, -H].map(|h| {
            let at = moved(&robot, &q, &qd, h);
            kinematics(&robot, &at, &mut data);
            (0..robot.links.len()).map(|i| point_position(&data, i, &local)).collect::<Vec<_>>()
        });
        kinematics(&robot, &q, &mut data);
        velocities(&robot, &qd, &mut data);
        for i in 0..robot.links.len() {
            let said = data.velocity[i].at(&(data.position[i] + data.rotation[i] * local));
            let seen = (ahead[i] - behind[i]) / (2.0 * H);
            worst = worst.max(gap(seen.as_slice(), said.as_slice()));
        }
    }
    println!("point velocities: {worst:.1e}");
    assert!(worst < 1e-7, "velocities of points differ from central differences by {worst:.1e}, allowed 1e-7");
}

#[test]
fn mass_matrix_is_the_hessian_of_kinetic_energy() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots() {
        let (q, mut data, n) = (state(&mut rng, &robot).0, Data::new(&robot), robot.nv());
        let mut at = |i: usize, j: usize| {
            let mut qd = vec![0.0; n];
            qd[i] += 1.0;
            qd[j] += 1.0;
            kinetic(&robot, &q, &qd, &mut data)
        };
        // T(e_i + e_i) = 4 T(e_i) = 2 M_ii, and T(e_i + e_j) - T(e_i) - T(e_j) = M_ij.
        let diagonal: Vec<f64> = (0..n).map(|i| at(i, i) / 2.0).collect();
        let expected = DMatrix::from_fn(n, n, |i, j| if i == j { diagonal[i] } else { at(i, j) - 0.5 * (diagonal[i] + diagonal[j]) });
        crba(&robot, &mut data);
        worst = worst.max(gap(data.mass.as_slice(), expected.as_slice()));
    }
    println!("mass matrix: {worst:.1e}");
    assert!(worst < 1e-10, "mass matrix differs from the Hessian of T by {worst:.1e} of the largest entry, allowed 1e-10");
}

#[test]
fn gravity_torque_is_the_gradient_of_potential_energy() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots() {
        let (q, mut data, n) = (state(&mut rng, &robot).0, Data::new(&robot), robot.nv());
        let gradient: Vec<f64> = (0..n)
            .map(|i| {
                let mut qd = vec![0.0; n];
                qd[i] = 1.0;
                let [ahead, behind] = [H, -H].map(|h| potential(&robot, &moved(&robot, &q, &qd, h), &mut data));
                (ahead - behind) / (2.0 * H)
            })
            .collect();
        kinematics(&robot, &q, &mut data);
        bias(&robot, &vec![0.0; n], &Vector3::from(GRAVITY), &mut data);
        worst = worst.max(gap(data.tau.as_slice(), &gradient));
    }
    println!("gravity: {worst:.1e}");
    assert!(worst < 1e-7, "gravity torques differ from dV/dq by {worst:.1e} of the largest, allowed 1e-7");
}

#[test]
fn energy_changes_by_the_work_of_the_torques_alone() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots() {
        let (q, qd) = state(&mut rng, &robot);
        let (tau, mut data) = (values(&mut rng, robot.nv(), 20.0), Data::new(&robot));
        kinematics(&robot, &q, &mut data);
        assert!(aba(&robot, &qd, &tau, &Vector3::from(GRAVITY), &mut data));
        let mut rate = data.qdd.as_slice().to_vec();
        if robot.floating() {
            // The spatial acceleration is p_ddot - w x p_dot.
            let turn = vector(&qd).cross(&vector(&qd[3..]));
            (0..3).for_each(|k| rate[3 + k] += turn[k]);
        }
        // A parabola through the state touches the true motion to third order.
        let [ahead, behind] = [H, -H].map(|h| {
            let along = |part: f64| qd.iter().zip(&rate).map(|(v, a)| v + part * h * a).collect::<Vec<_>>();
            let at = moved(&robot, &q, &along(0.5), h);
            kinetic(&robot, &at, &along(1.0), &mut data) + potential(&robot, &at, &mut data)
        });
        let (gained, work) = ((ahead - behind) / (2.0 * H), qd.iter().zip(&tau).map(|(v, t)| v * t).sum::<f64>());
        // Kinetic and potential energy exchange far more than the torques bring: that is the scale of the error.
        let scale = rate.iter().zip(&qd).zip(data.mass.diagonal().iter()).fold(work.abs().max(1.0), |m, ((a, v), _)| m.max((a * v).abs()));
        worst = worst.max((gained - work).abs() / scale);
    }
    println!("power: {worst:.1e}");
    assert!(worst < 1e-6, "energy and work differ by {worst:.1e} of the power exchanged, allowed 1e-6");
}
