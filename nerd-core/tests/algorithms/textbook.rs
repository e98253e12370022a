//! Motions with a closed form: the cartpole, the double pendulum, a free rigid body.
//!
//! Tolerance: accelerations agree with closed forms to rounding, 1e-13 of the largest.

use super::common::*;

const DOWN: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);

/// Accelerations and mass matrices against a closed form `(M, rhs)` in 1000 random states.
fn obeys(name: &str, urdf: &str, closed: impl Fn(&[f64], &[f64], &[f64]) -> ([[f64; 2]; 2], [f64; 2])) {
    let mut robot = Robot::from_urdf(urdf, Base::fixed()).expect("a valid asset");
    robot.joints_mut().for_each(|j| j.armature = 0.01);
    let (mut rng, mut data, mut worst) = (Rng::seed_from_u64(0), Data::new(&robot), [0.0f64; 2]);
    for _ in 0..1000 {
        let (q, qd, tau) = (values(&mut rng, 2, 4.0), values(&mut rng, 2, 10.0), values(&mut rng, 2, 1500.0));
        let ([[a, b], [c, d]], [x, y]) = closed(&q, &qd, &tau);
        let det = a * d - b * c;
        let expected = [(d * x - b * y) / det, (a * y - c * x) / det];
        let qdd = data.forward_dynamics(&robot, &q, &LocalVelocity(qd), &tau, &DOWN).expect("inertia");
        worst[0] = worst[0].max(gap(qdd.as_slice(), &expected));
        worst[1] = worst[1].max(gap(data.mass_matrix(&robot, &q).as_slice(), &[a, c, b, d]));
    }
    assert!(worst.iter().all(|w| *w < 1e-13), "{name} is off by {worst:?}, allowed 1e-13");
}

#[test]
fn cartpole_obeys_its_closed_form() {
    let (mc, mp, l, iyy, g) = (3.0, 0.4, 0.5, 0.03, 9.81);
    obeys("cartpole", include_str!("../../assets/cartpole.urdf"), |q, qd, tau| {
        let (sin, cos) = q[1].sin_cos();
        let m = [[mc + mp + 0.01, mp * l * cos], [mp * l * cos, iyy + mp * l * l + 0.01]];
        (m, [tau[0] + mp * l * sin * qd[1] * qd[1], tau[1] + mp * g * l * sin])
    });
}

/// Two equal links, angles from the horizontal: mass, length, half length, inertia about the axis at the centre.
#[test]
fn double_pendulum_obeys_its_closed_form() {
    let (m, l, h, i, g) = (1.2, 1.0, 0.5, 0.1, 9.81);
    obeys("double pendulum", include_str!("../../assets/pendulum.urdf"), |q, qd, tau| {
        let (sin, cos) = q[1].sin_cos();
        let own = i + m * h * h;
        let both = own + m * l * h * cos;
        let mass = [[own + m * l * l + both + m * l * h * cos + 0.01, both], [both, own + 0.01]];
        let weight = m * g * h * (q[0] + q[1]).cos();
        let swing = m * l * h * sin;
        let first = tau[0] + swing * qd[1] * (2.0 * qd[0] + qd[1]) - m * g * (h + l) * q[0].cos() - weight;
        (mass, [first, tau[1] - swing * qd[0] * qd[0] - weight])
    });
}

#[test]
fn a_free_body_obeys_eulers_equations() {
    for seed in 0..50 {
        let mut rng = Rng::seed_from_u64(seed);
        let mut robot = robot(&mut rng, 0, true);
        robot.links[0].inertia.com = Vector3::zeros();
        let ((q, qd), tau) = (state(&mut rng, &robot), values(&mut rng, 6, 1.0));
        let mut data = Data::new(&robot);
        let qdd = data.forward_dynamics(&robot, &q, &qd, &tau, &DOWN).expect("inertia").clone();
        let root = robot.frame("root").expect("the body");
        let (body, r) = (robot.links[0].inertia, robot.pose(&q, &root).rotation.to_rotation_matrix());
        let inertia = r.matrix() * body.inertia * r.matrix().transpose();
        let (w, torque) = (Motion::from_slice(&qd.0).ang, Wrench::from_slice(&tau));
        // I w_dot = n - w x I w, and m p_ddot = f + m g. The rate of the twist would lack w x p_dot.
        let turn = inertia.try_inverse().expect("a body has inertia") * (torque.ang - w.cross(&(inertia * w)));
        let push = torque.lin / body.mass + DOWN;
        let off = gap(qdd.as_slice(), &[turn.as_slice(), push.as_slice()].concat());
        assert!(off < 1e-13, "Euler's equations are off by {off:.1e}, allowed 1e-13");
    }
}
