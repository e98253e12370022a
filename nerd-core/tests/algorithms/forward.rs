//! Forward dynamics by ABA, by the mass matrix (CRBA with dense and sparse factors) and by inverse dynamics (RNEA)
//! agree, on random trees up to 30 joints.
//!
//! Tolerance: the results differ by rounding (1e-16) times the condition of the mass matrix (up to 1e5 here), hence
//! 1e-10 of the largest entry.

use super::common::*;
use nerd_core::dynamics::Factor;

const BOUND: f64 = 1e-10;

fn accelerations(robot: &Robot, q: &[f64], qd: &LocalVelocity<Vec<f64>>, tau: &[f64]) -> Vec<f64> {
    Data::new(robot).forward_dynamics(robot, q, qd, tau, &GRAVITY).expect("inertia").as_slice().to_vec()
}

type Ask<'a> = &'a dyn Fn(&mut Data) -> Vec<f64>;

#[test]
fn articulated_bodies_mass_matrix_and_inverse_dynamics_agree() {
    let mut worst = [0.0f64; 4];
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
            // For each DoF, the diagonal entry of the inverse.
            for k in 0..robot.nv() {
                let mut one: Vec<f64> = (0..robot.nv()).map(|i| f64::from(i == k)).collect();
                let mut same: Vec<_> = one.iter().map(|x| nalgebra::Vector2::new(*x, -2.0 * x)).collect();
                factor.solve(&mut one);
                let found = factor.inv_mass(k, &mut same);
                let right = nalgebra::Matrix2::new(1.0, -2.0, -2.0, 4.0) * one[k];
                worst[3] = worst[3].max((found - right).norm() / right.norm());
            }
            factor.solve(&mut x);
            worst[1] = worst[1].max(gap(&x, qdd.as_slice()));
            let back = data.inverse_dynamics(&robot, &q, &qd, qdd.as_slice(), &GRAVITY);
            worst[2] = worst[2].max(gap(back.as_slice(), &tau));
        }
    }
    assert!(
        worst.iter().all(|w| *w < BOUND),
        "ABA against dense, sparse and inverse dynamics: {worst:?}, allowed {BOUND:.0e}"
    );
}

/// Earlier calls at other coordinates change no result.
#[test]
fn answers_are_of_the_coordinates_given() {
    for (robot, mut rng) in robots() {
        let ((q, qd), (other, faster)) = (state(&mut rng, &robot), state(&mut rng, &robot));
        let (tau, frame) = (values(&mut rng, robot.nv(), 20.0), robot.frame(&robot.links[0].name).expect("a link"));
        let asks: [Ask; 6] = [
            &|data| data.mass_matrix(&robot, &q).as_slice().to_vec(),
            &|data| data.gravity_torque(&robot, &q, &GRAVITY).as_slice().to_vec(),
            &|data| data.bias(&robot, &q, &qd, &GRAVITY).as_slice().to_vec(),
            &|data| data.forward_dynamics(&robot, &q, &qd, &tau, &GRAVITY).expect("inertia").as_slice().to_vec(),
            &|data| data.jacobian(&robot, &q, &frame, Axes::World).as_slice().to_vec(),
            &|data| data.jacobian_rate(&robot, &q, &qd, &frame, Axes::World).as_slice().to_vec(),
        ];
        let mut used = Data::new(&robot);
        for (k, ask) in asks.iter().enumerate() {
            used.jacobian_rate(&robot, &other, &faster, &frame, Axes::Local);
            used.forward_dynamics(&robot, &other, &faster, &tau, &GRAVITY).expect("inertia");
            assert_eq!(ask(&mut used), ask(&mut Data::new(&robot)), "call {k}, {} DoF", robot.nv());
        }
    }
}

#[test]
fn moving_the_base_100_km_changes_accelerations_by_rounding_only() {
    // A twist about the world's origin contains w x p, 1e5 m/s here. Its rounding loses 1e-11 m/s of p_dot.
    for (mut robot, mut rng) in robots() {
        let ((mut q, qd), tau) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 20.0));
        let near = accelerations(&robot, &q, &qd, &tau);
        match &mut robot.base {
            Base::Fixed(pose) => pose.translation.vector += Vector3::new(1e5, -1e5, 1e5),
            Base::Floating => (0..3).for_each(|k| q[k] += 1e5),
        }
        let far = qd.into_twist(&robot, &q).into_local(&robot, &q);
        let off = gap(&accelerations(&robot, &q, &far, &tau), &near);
        assert!(off < 1e-9, "100 km away accelerations differ by {off:.1e} of the largest, allowed 1e-9");
    }
}

/// A massless chain has no accelerations: the fault names its last joint. A massless root rotates freely within its
/// child; rounding leaves something on the diagonal, positive or not.
#[test]
fn without_inertia_there_is_no_answer_but_a_name() {
    for seed in 0..50 {
        let mut rng = Rng::seed_from_u64(seed);
        let [mut arm, mut free] = [false, true].map(|floating| robot(&mut rng, 3, floating));
        arm.links.iter_mut().chain(&mut free.links[..1]).for_each(|link| link.inertia = Default::default());
        arm.joints_mut().chain(free.joints_mut()).for_each(|j| j.armature = 0.0);
        let (q, qd) = state(&mut rng, &arm);
        let error =
            Data::new(&arm).forward_dynamics(&arm, &q, &qd, &[0.0; 3], &GRAVITY).expect_err("no inertia").to_string();
        assert!(error.contains("joint2"), "{error}");
        if free.links.iter().filter(|l| l.parent == Some(0)).count() == 1 {
            let (mut data, mut factor) = (Data::new(&free), Factor::new(&free));
            let mass = data.mass_matrix(&free, &state(&mut rng, &free).0);
            assert!(!factor.refill(mass), "seed {seed}: a singular mass matrix was factorised");
            assert!(factor.fault(&free).contains("`root`"), "{}", factor.fault(&free));
        }
    }
}
