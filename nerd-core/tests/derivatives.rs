//! Jacobians and derivatives against differences, on random trees, some of whose joints follow others.

mod common;

use common::*;
use nalgebra::{DMatrix, DVector, Vector3};
use nerd_core::dynamics::*;
use nerd_core::robot::{FixedFrame, Robot};
use nerd_core::state::{difference, integrate};

const GRAVITY: Vector3<f64> = Vector3::new(0.3, -0.5, -9.81);
const STEP: f64 = 1e-5;

/// Every second robot with joints that follow others.
fn all() -> impl Iterator<Item = (Robot, Rng)> {
    robots().enumerate().map(|(k, (robot, mut rng))| (if k % 4 < 2 { following(&mut rng, &robot) } else { robot }, rng))
}

/// Central differences of `f` along every tangent at q and every rate.
fn differences(robot: &Robot, q: &[f64], qd: &[f64], mut f: impl FnMut(&[f64], &[f64]) -> DVector<f64>) -> [DMatrix<f64>; 2] {
    let nv = robot.nv();
    let (mut by_q, mut by_qd) = (DMatrix::zeros(nv, nv), DMatrix::zeros(nv, nv));
    for k in 0..nv {
        let mut at = |sign: f64| {
            let mut v = vec![0.0; nv];
            v[k] = sign * STEP;
            let mut moved = q.to_vec();
            integrate(robot, q, &v, &mut moved);
            let faster: Vec<f64> = qd.iter().zip(&v).map(|(a, b)| a + b).collect();
            [f(&moved, qd), f(q, &faster)]
        };
        let ([q1, v1], [q0, v0]) = (at(1.0), at(-1.0));
        by_q.set_column(k, &((q1 - q0) / (2.0 * STEP)));
        by_qd.set_column(k, &((v1 - v0) / (2.0 * STEP)));
    }
    [by_q, by_qd]
}

fn off(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).amax() / b.amax().max(1.0)
}

#[test]
fn derivatives_of_inverse_dynamics() {
    for (robot, mut rng) in all() {
        let (q, qd) = state(&mut rng, &robot);
        let qdd = values(&mut rng, robot.nv(), 2.0);
        let mut data = Data::new(&robot);
        push(&mut rng, &mut data);
        let mut found = Derivatives::new(&robot);
        kinematics(&robot, &q, &mut data);
        found.inverse(&robot, &qd, &qdd, &GRAVITY, &mut data);
        let told = differences(&robot, &q, &qd, |q, qd| {
            kinematics(&robot, q, &mut data);
            rnea(&robot, qd, &qdd, &GRAVITY, &mut data);
            data.tau.clone()
        });
        let apart = [off(&found.q, &told[0]), off(&found.qd, &told[1])];
        assert!(apart.iter().all(|x| *x < 1e-7), "{} DoF, floating {}: {apart:?} off (q, qd)", robot.nv(), robot.floating());
    }
}

#[test]
fn derivatives_of_forward_dynamics() {
    for (robot, mut rng) in all() {
        let (q, qd) = state(&mut rng, &robot);
        let tau = values(&mut rng, robot.nv(), 2.0);
        let mut data = Data::new(&robot);
        push(&mut rng, &mut data);
        kinematics(&robot, &q, &mut data);
        assert!(aba(&robot, &qd, tau.as_slice(), &GRAVITY, &mut data));
        let qdd: Vec<f64> = data.qdd.iter().copied().collect();
        let (mut found, mut factor) = (Derivatives::new(&robot), Factor::new(&robot));
        assert!(found.forward(&robot, &qd, &qdd, &GRAVITY, &mut data, &mut factor));
        let told = differences(&robot, &q, &qd, |q, qd| {
            kinematics(&robot, q, &mut data);
            assert!(aba(&robot, qd, tau.as_slice(), &GRAVITY, &mut data));
            data.qdd.clone()
        });
        let apart = [off(&found.q, &told[0]), off(&found.qd, &told[1])];
        assert!(apart.iter().all(|x| *x < 1e-6), "{} DoF, floating {}: {apart:?} off (q, qd)", robot.nv(), robot.floating());
    }
}

#[test]
fn jacobians() {
    for (robot, mut rng) in all() {
        let (q, qd) = state(&mut rng, &robot);
        let mut data = Data::new(&robot);
        let (mut j, mut com) = (DMatrix::zeros(6, robot.nv()), DMatrix::zeros(3, robot.nv()));
        let local = vector3(&mut rng, 0.3);
        let link = robot.links.len() - 1;
        kinematics(&robot, &q, &mut data);
        jacobian(&robot, &data, link, &local, &mut j);
        com_jacobian(&robot, &data, &mut com);
        let rate = DVector::from_column_slice(&qd);
        let (told, told_com) = (&j * &rate, Vector3::from((&com * &rate).fixed_rows::<3>(0)));
        let mut at = |sign: f64| {
            let v: Vec<f64> = qd.iter().map(|v| sign * STEP * v).collect();
            let mut moved = q.clone();
            integrate(&robot, &q, &v, &mut moved);
            kinematics(&robot, &moved, &mut data);
            let mass = com_jacobian(&robot, &data, &mut com);
            (point_position(&data, link, &local), data.rotation[link], mass)
        };
        let (b, a) = (at(1.0), at(-1.0));
        let turn = (b.1 * a.1.transpose() - a.1 * b.1.transpose()) / (4.0 * STEP);
        let turn = Vector3::new(turn[(2, 1)], turn[(0, 2)], turn[(1, 0)]);
        let apart = [
            (turn - told.fixed_rows::<3>(0)).amax(),
            ((b.0 - a.0) / (2.0 * STEP) - told.fixed_rows::<3>(3)).amax(),
            ((b.2 - a.2) / (2.0 * STEP) - told_com).amax(),
        ];
        assert!(apart.iter().all(|x| *x < 1e-7), "{apart:?} off (turning, place, centre of mass)");
        // The momentum of the whole is its mass times that velocity.
        let state = [q.as_slice(), &world(&robot, &q, &qd)].concat();
        let totals = totals(&robot, &state, &mut data);
        let apart = (totals.momentum.lin - told_com * totals.mass).amax();
        assert!(apart < 1e-12 * totals.momentum.lin.amax().max(1.0), "momentum {apart:.1e} off");
    }
}

#[test]
fn frames_of_fixed_links_move_with_what_carries_them() {
    for (mut robot, mut rng) in all() {
        let (q, qd) = state(&mut rng, &robot);
        let link = robot.links.len() - 1;
        robot.frames.push(FixedFrame { name: "sole".into(), link: Some(link), pose: pose(&mut rng, 0.3) });
        let frame = robot.frame("sole").expect("a frame");
        assert!(robot.frame(&robot.links[link].name).is_some_and(|f| f.link == Some(link)) && robot.frame("moon").is_none());
        let mut data = Data::new(&robot);
        let mut j = DMatrix::zeros(6, robot.nv());
        kinematics(&robot, &q, &mut data);
        velocities(&robot, &qd, &mut data);
        frame_jacobian(&robot, &data, &frame, &mut j);
        let (told, moves) = (&j * DVector::from_column_slice(&qd), frame_velocity(&data, &frame));
        let apart = (told.fixed_rows::<3>(0) - moves.ang).amax().max((told.fixed_rows::<3>(3) - moves.lin).amax());
        assert!(apart < 1e-12, "J qd is {apart:.1e} from the frame's own velocity");
        let mut at = |sign: f64| {
            let v: Vec<f64> = qd.iter().map(|v| sign * STEP * v).collect();
            let mut moved = q.clone();
            integrate(&robot, &q, &v, &mut moved);
            kinematics(&robot, &moved, &mut data);
            frame_pose(&robot, &data, &frame)
        };
        let (b, a) = (at(1.0), at(-1.0));
        let turn = (b.rotation * a.rotation.inverse()).scaled_axis() / (2.0 * STEP);
        let went = (b.translation.vector - a.translation.vector) / (2.0 * STEP);
        let apart = (turn - moves.ang).amax().max((went - moves.lin).amax());
        assert!(apart < 1e-7, "its pose moves {apart:.1e} otherwise than its velocity says");
        // The call that takes q does both steps.
        let qdd = values(&mut rng, robot.nv(), 2.0);
        inverse_dynamics(&robot, &q, &qd, &qdd, &GRAVITY, &mut data);
        let at_once = data.tau.clone();
        kinematics(&robot, &q, &mut data);
        rnea(&robot, &qd, &qdd, &GRAVITY, &mut data);
        assert_eq!(at_once, data.tau);
    }
}

fn world(robot: &Robot, q: &[f64], qd: &[f64]) -> Vec<f64> {
    let mut qd = qd.to_vec();
    to_world(robot, q, &mut qd);
    qd
}

#[test]
fn a_difference_leads_where_it_says() {
    for (robot, mut rng) in all() {
        let ((a, v), (b, _)) = (state(&mut rng, &robot), state(&mut rng, &robot));
        let (mut way, mut there) = (vec![0.0; robot.nv()], a.clone());
        difference(&robot, &a, &b, &mut way);
        integrate(&robot, &a, &way, &mut there);
        let mut rest = vec![0.0; robot.nv()];
        difference(&robot, &b, &there, &mut rest);
        let apart = rest.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        assert!(apart < 1e-12, "{apart:.1e} from where the difference leads");
        integrate(&robot, &a, &v, &mut there);
        difference(&robot, &a, &there, &mut way);
        // Turns of less than half a circle come back as they were.
        let apart = way.iter().zip(&v).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-12, "{apart:.1e} from the tangent that was followed");
    }
}
