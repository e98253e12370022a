//! The dynamics follow from one kinetic and one potential energy, computed here from link poses and twists.
//!
//! Tolerances: polarisation of the (quadratic) kinetic energy is exact up to rounding. A central difference with step h
//! errs by h^2 times the third derivative plus 1e-16 E / h. At h = 1e-5 both are about 1e-8 of the largest term.

use super::common::*;

const H: f64 = 1e-5;

/// Kinetic and potential energy (J).
fn energies(robot: &Robot, q: &[f64], qd: &LocalVelocity<Vec<f64>>, data: &mut Data) -> [f64; 2] {
    let totals = totals(robot, &whole(robot, q, qd), data);
    [totals.kinetic, totals.energy(&GRAVITY) - totals.kinetic]
}

#[test]
fn mass_matrix_is_the_hessian_of_kinetic_energy() {
    for (robot, mut rng) in robots() {
        let (q, mut data, n) = (state(&mut rng, &robot).0, Data::new(&robot), robot.nv());
        let mut at = |i: usize, j: usize| {
            let mut qd = vec![0.0; n];
            qd[i] += 1.0;
            qd[j] += 1.0;
            energies(&robot, &q, &LocalVelocity(qd), &mut data)[0]
        };
        // T(e_i + e_i) = 4 T(e_i) = 2 M_ii, and T(e_i + e_j) - T(e_i) - T(e_j) = M_ij.
        let diagonal: Vec<f64> = (0..n).map(|i| at(i, i) / 2.0).collect();
        let expected =
            DMatrix::from_fn(
                n,
                n,
                |i, j| if i == j { diagonal[i] } else { at(i, j) - 0.5 * (diagonal[i] + diagonal[j]) },
            );
        let off = gap(data.mass_matrix(&robot, &q).as_slice(), expected.as_slice());
        assert!(
            off < 1e-10,
            "mass matrix differs from the Hessian of T by {off:.1e} of the largest entry, allowed 1e-10"
        );
    }
}

#[test]
fn gravity_torque_is_the_gradient_of_potential_energy() {
    for (robot, mut rng) in robots() {
        let (q, mut data, n) = (state(&mut rng, &robot).0, Data::new(&robot), robot.nv());
        let mut along = |i: usize| {
            let mut qd = LocalVelocity(vec![0.0; n]);
            qd.0[i] = 1.0;
            rate(&robot, &q, &qd, H, |q| energies(&robot, q, &qd, &mut data)[1])
        };
        let gradient: Vec<f64> = (0..n).map(&mut along).collect();
        let off = gap(data.gravity_torque(&robot, &q, &GRAVITY).as_slice(), &gradient);
        assert!(off < 1e-7, "gravity torques differ from dV/dq by {off:.1e} of the largest, allowed 1e-7");
    }
}

#[test]
fn energy_changes_by_the_work_of_the_torques_alone() {
    for (robot, mut rng) in robots() {
        let ((q, qd), tau) = (state(&mut rng, &robot), values(&mut rng, robot.nv(), 20.0));
        let mut data = Data::new(&robot);
        let qdd = data.forward_dynamics(&robot, &q, &qd, &tau, &GRAVITY).expect("inertia").clone();
        // A parabola through the state matches the true motion to third order.
        let [ahead, behind] = [H, -H].map(|h| {
            let along = |part: f64| {
                LocalVelocity(qd.0.iter().zip(qdd.iter()).map(|(v, a)| v + part * h * a).collect::<Vec<_>>())
            };
            energies(&robot, &moved(&robot, &q, &along(0.5), h), &along(1.0), &mut data).iter().sum::<f64>()
        });
        let (gained, work) = ((ahead - behind) / (2.0 * H), qd.0.iter().zip(&tau).map(|(v, t)| v * t).sum::<f64>());
        // The power exchanged between kinetic and potential energy exceeds the torques' power, so it sets the scale.
        let mass = data.mass_matrix(&robot, &q).diagonal();
        let scale =
            qdd.iter().zip(&qd.0).zip(mass.iter()).fold(work.abs().max(1.0), |m, ((a, v), _)| m.max((a * v).abs()));
        let off = (gained - work).abs() / scale;
        assert!(off < 1e-6, "energy and work differ by {off:.1e} of the power exchanged, allowed 1e-6");
    }
}
