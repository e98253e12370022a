//! Solving along the tree against the matrix and its factor.

mod common;

use common::*;
use nalgebra::{DMatrix, DVector, Matrix6, Vector3};
use nerd_core::dynamics::{Data, TreeFactor, crba, kinematics};
use nerd_core::robot::Robot;
use nerd_core::spatial::{Motion, Wrench};
use rand::RngExt;

/// The matrix `M + sum J^T K J + diag e`, with all of it dense.
fn whole(robot: &Robot, data: &Data, links: &[Matrix6<f64>], joints: &[f64]) -> DMatrix<f64> {
    let mut m = data.mass.clone();
    for (i, k) in links.iter().enumerate() {
        let j = twists(robot, data, i);
        m += j.transpose() * k * &j;
    }
    joints.iter().enumerate().for_each(|(i, e)| m[(robot.root_dofs() + i, robot.root_dofs() + i)] += e);
    m
}

/// 6 x nv: the twist of a link about the origin, by DoF.
fn twists(robot: &Robot, data: &Data, link: usize) -> DMatrix<f64> {
    let mut j = DMatrix::zeros(6, robot.nv());
    let mut at = Some(link);
    while let Some(i) = at {
        if robot.links[i].joint.is_some() {
            let Motion { ang, lin } = data.axis[i];
            j.column_mut(data.dof[i]).copy_from_slice(&[ang.x, ang.y, ang.z, lin.x, lin.y, lin.z]);
        } else {
            (0..6).for_each(|k| j[(k, k)] = 1.0);
        }
        at = robot.links[i].parent;
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
        let (mut data, nv) = (Data::new(&robot), robot.nv());
        for round in 0..6 {
            let (q, _) = state(&mut rng, &robot);
            kinematics(&robot, &q, &mut data);
            crba(&robot, &mut data);
            let mut number = || 2.0 * rng.random::<f64>() - 1.0;
            // Positive semi-definite, as large as the inertias.
            let mut stiff = |scale: f64| {
                let a = Matrix6::from_fn(|_, _| number());
                a * a.transpose() * scale
            };
            let scale = if round % 2 == 0 { 0.0 } else { robot.mass() };
            let links: Vec<Matrix6<f64>> = robot.links.iter().map(|_| stiff(scale)).collect();
            let joints: Vec<f64> = (0..robot.joint_count()).map(|_| number().abs() * scale).collect();
            let press: Vec<Wrench> =
                robot.links.iter().map(|_| Wrench::new(Vector3::from_fn(|_, _| number()), Vector3::from_fn(|_, _| number()))).collect();
            let tau: Vec<f64> = (0..nv).map(|_| number()).collect();
            let matrix = whole(&robot, &data, &links, &joints);
            let mut right = DVector::from_column_slice(&tau);
            for (i, w) in press.iter().enumerate() {
                let w = DVector::from_column_slice(&[w.ang.x, w.ang.y, w.ang.z, w.lin.x, w.lin.y, w.lin.z]);
                right += twists(&robot, &data, i).transpose() * w;
            }
            let inverse = matrix.try_inverse().expect("positive definite");
            let x = &inverse * right;
            assert!(tree.refill(&robot, &data, &links, &joints), "{}: no factor", robot.name);
            let mut own = tau.clone();
            tree.solve(&robot, &data, &press, &mut own);
            assert!(own.iter().all(|x| x.is_finite()), "{}: {own:?}", robot.name);
            let largest = x.amax();
            worst[0] = worst[0].max(own.iter().zip(x.iter()).map(|(a, b)| (a - b).abs() / largest).fold(0.0, f64::max));
            tree.spread(&robot, &data);
            for (i, link) in robot.links.iter().enumerate() {
                let j = twists(&robot, &data, i);
                let a = &j * &x;
                let Motion { ang, lin } = tree.acceleration(i);
                let told = DVector::from_column_slice(&[ang.x, ang.y, ang.z, lin.x, lin.y, lin.z]);
                worst[1] = worst[1].max((told - &a).amax() / (a.amax() + largest));
                let ease = &j * &inverse * j.transpose();
                let Motion { ang, lin } = tree.eased(i, &press[i]);
                let (w, told) = (&press[i], DVector::from_column_slice(&[ang.x, ang.y, ang.z, lin.x, lin.y, lin.z]));
                let w = DVector::from_column_slice(&[w.ang.x, w.ang.y, w.ang.z, w.lin.x, w.lin.y, w.lin.z]);
                worst[2] = worst[2].max((told - &ease * w).amax() / ease.amax());
                if link.joint.is_some() {
                    let k = data.dof[i];
                    worst[3] = worst[3].max((tree.ease(&robot, i) / inverse[(k, k)] - 1.0).abs());
                }
            }
        }
    }
    println!(
        "largest relative difference: solution {:.1e}, links {:.1e}, wrenches {:.1e}, diagonal {:.1e}",
        worst[0], worst[1], worst[2], worst[3]
    );
    assert!(worst.iter().all(|w| *w < 1e-9), "{worst:?}");
}
