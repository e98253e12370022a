//! `TreeFactor` against the dense matrix and its inverse.

use super::common::*;
use nalgebra::Matrix6;
use nerd_core::dynamics::{TreeFactor, crba};

/// Jacobian of a link's twist about the origin, 6 by `nv`.
fn twists(robot: &Robot, data: &Data, link: usize) -> DMatrix<f64> {
    let mut j = DMatrix::zeros(6, robot.nv());
    for i in std::iter::successors(Some(link), |i| robot.links[*i].parent) {
        match robot.links[i].joint {
            Some(_) => j.column_mut(data.dof[i]).copy_from(&data.axis[i].vector()),
            None => (0..6).for_each(|k| j[(k, k)] = 1.0),
        }
    }
    j
}

#[test]
fn a_solution_along_the_tree_is_that_of_the_matrix() {
    let mut rng = Rng::seed_from_u64(3);
    let mut worst = [0.0f64; 4];
    for k in 0..24 {
        let robot = robot(&mut rng, 1 + k, k % 2 == 0);
        let mut tree = TreeFactor::new(&robot).expect("nothing follows anything");
        let mut data = Data::new(&robot);
        for round in 0..6 {
            kinematics(&robot, &state(&mut rng, &robot).0, &mut data);
            crba(&robot, &mut data);
            // Positive semi-definite, as large as the inertias.
            let scale = if round % 2 == 0 { 0.0 } else { robot.mass() };
            let mut stiff = || {
                let a = Matrix6::from_column_slice(&values(&mut rng, 36, 1.0));
                a * a.transpose() * scale
            };
            let links: Vec<Matrix6<f64>> = robot.links.iter().map(|_| stiff()).collect();
            let joints: Vec<f64> = values(&mut rng, robot.joint_count(), 1.0).iter().map(|x| x.abs() * scale).collect();
            let press: Vec<Wrench> =
                robot.links.iter().map(|_| Wrench::from_slice(&values(&mut rng, 6, 1.0))).collect();
            let tau = values(&mut rng, robot.nv(), 1.0);
            // Dense reference: M + sum J^T K J + diag e, and tau + sum J^T w.
            let (mut matrix, mut right) = (data.mass.clone(), DVector::from_column_slice(&tau));
            let moves: Vec<DMatrix<f64>> = (0..robot.links.len()).map(|i| twists(&robot, &data, i)).collect();
            for ((j, k), w) in moves.iter().zip(&links).zip(&press) {
                matrix += j.transpose() * k * j;
                right += j.transpose() * w.vector();
            }
            joints.iter().enumerate().for_each(|(i, e)| matrix[(robot.root_dofs() + i, robot.root_dofs() + i)] += e);
            let inverse = matrix.try_inverse().expect("positive definite");
            let x = &inverse * right;
            assert!(tree.refill(&robot, &data, &links, &joints), "{} joints: no factor", k + 1);
            let mut own = tau.clone();
            tree.solve(&robot, &data, &press, &mut own);
            worst[0] = worst[0].max((DVector::from_vec(own) - &x).amax() / x.amax());
            tree.spread(&robot, &data);
            for (i, j) in moves.iter().enumerate() {
                let (a, inv_mass) = (j * &x, j * &inverse * j.transpose());
                worst[1] = worst[1].max((tree.acceleration(i).vector() - &a).amax() / (a.amax() + x.amax()));
                worst[2] = worst[2].max(
                    (tree.response(i, &press[i]).vector() - &inv_mass * press[i].vector()).amax() / inv_mass.amax(),
                );
                if robot.links[i].joint.is_some() {
                    let k = data.dof[i];
                    worst[3] = worst[3].max((tree.inv_mass(&robot, i) / inverse[(k, k)] - 1.0).abs());
                }
            }
        }
    }
    assert!(worst.iter().all(|w| *w < 1e-9), "solution, links, wrenches, diagonal: {worst:?} off");
}
