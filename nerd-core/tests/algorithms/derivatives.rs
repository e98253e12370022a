//! Jacobians, their rates and analytic derivatives against central differences, on random trees, some with mimic
//! joints.

use super::common::*;
use nalgebra::Vector6;
use nerd_core::state::{difference, integrate};
use nerd_core::tangent;

const STEP: f64 = 1e-5;

/// The random robots: every second pair with mimic joints, two of three with gravity compensation.
fn all() -> impl Iterator<Item = (Robot, Rng)> {
    robots().enumerate().map(|(k, (robot, mut rng))| {
        let mut own = if k % 4 < 2 { following(&mut rng, &robot) } else { robot };
        if k % 3 > 0 {
            lifted(&mut rng, &mut own);
        }
        (own, rng)
    })
}

type Velocity = LocalVelocity<Vec<f64>>;

/// Largest relative error of `found` against central differences of `f`, along every tangent at q and every qd.
fn off(
    robot: &Robot,
    found: &Derivatives,
    q: &[f64],
    qd: &Velocity,
    mut f: impl FnMut(&[f64], &Velocity) -> DVector<f64>,
) -> [f64; 2] {
    let nv = robot.nv();
    let mut worst = [(0.0f64, 1.0f64); 2];
    for k in 0..nv {
        let mut at = |sign: f64| {
            let mut v = vec![0.0; nv];
            v[k] = sign * STEP;
            let mut moved = q.to_vec();
            integrate(robot, q, &v, &mut moved);
            let faster = LocalVelocity(qd.0.iter().zip(&v).map(|(a, b)| a + b).collect());
            [f(&moved, qd), f(q, &faster)]
        };
        let (ahead, behind) = (at(1.0), at(-1.0));
        for (i, matrix) in [&found.q, &found.qd].into_iter().enumerate() {
            let column = (&ahead[i] - &behind[i]) / (2.0 * STEP);
            worst[i] = (worst[i].0.max((matrix.column(k) - &column).amax()), worst[i].1.max(column.amax()));
        }
    }
    worst.map(|(apart, scale)| apart / scale)
}

#[test]
fn derivatives_of_inverse_and_forward_dynamics() {
    for (robot, mut rng) in all() {
        let ((q, qd), given) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 2.0));
        let mut data = Data::new(&robot);
        push(&mut rng, &mut data);
        let found = data.inverse_derivatives(&robot, &q, &qd, &given, &GRAVITY);
        let inverse =
            off(&robot, &found, &q, &qd, |q, qd| data.inverse_dynamics(&robot, q, qd, &given, &GRAVITY).clone());
        let found = data.forward_derivatives(&robot, &q, &qd, &given, &GRAVITY).expect("inertia");
        let forward = off(&robot, &found, &q, &qd, |q, qd| {
            data.forward_dynamics(&robot, q, qd, &given, &GRAVITY).expect("inertia").clone()
        });
        let what = format!("{} DoF, floating {}: by q and qd off", robot.nv(), robot.floating());
        assert!(inverse.iter().all(|x| *x < 1e-7), "inverse, {what} {inverse:?}");
        assert!(forward.iter().all(|x| *x < 1e-6), "forward, {what} {forward:?}");
    }
}

/// Velocity of a frame from two poses `time` apart, in world axes.
fn went(ahead: Isometry3<f64>, behind: Isometry3<f64>, time: f64) -> Vector6<f64> {
    let turn = (ahead.rotation * behind.rotation.inverse()).scaled_axis() / time;
    let way = (ahead.translation.vector - behind.translation.vector) / time;
    Motion::new(turn, way).vector()
}

#[test]
fn jacobians_and_their_rates_in_both_axes() {
    for (mut robot, mut rng) in all() {
        let (q, qd) = state(&mut rng, &robot);
        let link = robot.links.len() - 1;
        robot.frames.push(FixedFrame { name: "tool".into(), link: Some(link), pose: pose(&mut rng, 0.3) });
        let (tool, mut data, rates) =
            (robot.frame("tool").expect("a frame"), Data::new(&robot), DVector::from_column_slice(&qd.0));
        let [ahead, behind] = [STEP, -STEP].map(|h| robot.pose(&moved(&robot, &q, &qd, h), &tool));
        let seen = went(ahead, behind, 2.0 * STEP);
        let own = robot.pose(&q, &tool).rotation.to_rotation_matrix().transpose();
        let turned = Motion::new(own * seen.fixed_rows::<3>(0), own * seen.fixed_rows::<3>(3)).vector();
        for (axes, seen) in [(Axes::World, seen), (Axes::Local, turned)] {
            let apart = (data.jacobian(&robot, &q, &tool, axes) * &rates - seen).amax();
            assert!(apart < 1e-7, "{axes:?}: J qd is {apart:.1e} from how the tool moves");
            let mut at = |h: f64| data.jacobian(&robot, &moved(&robot, &q, &qd, h), &tool, axes).clone();
            let expected: DMatrix<f64> = (at(STEP) - at(-STEP)) / (2.0 * STEP);
            let apart =
                (data.jacobian_rate(&robot, &q, &qd, &tool, axes) - &expected).amax() / expected.amax().max(1.0);
            assert!(apart < 1e-8, "{axes:?}: the rate of J is {apart:.1e} off");
        }
        let apart = (robot.velocity(&q, &qd, &tool).vector() - seen).amax();
        assert!(apart < 1e-7, "the tool's velocity is {apart:.1e} off");
    }
}

#[test]
fn the_centre_of_mass_moves_by_its_jacobian() {
    for (robot, mut rng) in all() {
        let ((q, qd), mut data) = (state(&mut rng, &robot), Data::new(&robot));
        let moves = data.com_jacobian(&robot, &q).1 * DVector::from_column_slice(&qd.0);
        let seen = rate(&robot, &q, &qd, STEP, |q| data.com_jacobian(&robot, q).0);
        assert!((&moves - seen).amax() < 1e-7, "{} m/s off", (&moves - seen).amax());
        // Linear momentum is mass times the velocity of the centre of mass.
        let totals = totals(&robot, &whole(&robot, &q, &qd), &mut data);
        let apart = (totals.momentum.lin - moves * totals.mass).amax();
        assert!(apart < 1e-12 * totals.momentum.lin.amax().max(1.0), "momentum {apart:.1e} off");
    }
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
        assert!(gap(&rest, &vec![0.0; robot.nv()]) < 1e-12, "the difference leads elsewhere: {rest:?} is left");
        integrate(&robot, &a, &v.0, &mut there);
        difference(&robot, &a, &there, &mut way);
        // `difference` recovers rotations below half a turn.
        assert!(gap(&way, &v.0) < 1e-12, "{way:?} is not the tangent that was followed");
    }
}

#[test]
fn gradients_by_numbers_are_those_of_the_tangent_space() {
    for (robot, mut rng) in robots() {
        let (q, qd) = state(&mut rng, &robot);
        let (state, nv) = (whole(&robot, &q, &qd), robot.nv());
        let [gradient, change] = [0; 2].map(|_| values(&mut rng, 2 * nv, 1.0));
        let by = tangent::by_numbers(&robot, &state, &gradient);
        let mut back = vec![0.0; 2 * nv];
        tangent::numbers_back(&robot, &state, &by, &mut back);
        assert!(gap(&back, &gradient) < 1e-12, "{nv} DoF: there and back {:.1e}", gap(&back, &gradient));
        let [ahead, behind] = [STEP, -STEP].map(|h| {
            let mut out = state.clone();
            tangent::moved(&robot, &state, &change.iter().map(|x| x * h).collect::<Vec<_>>(), &mut out);
            out
        });
        let along: f64 =
            by.iter().zip(ahead.iter().zip(&behind)).map(|(by, (a, b))| by * (a - b)).sum::<f64>() / (2.0 * STEP);
        let wanted: f64 = gradient.iter().zip(&change).map(|(s, c)| s * c).sum();
        assert!((along - wanted).abs() < 1e-7 * (1.0 + wanted.abs()), "{nv} DoF: {along} and {wanted} along a change");
    }
}
