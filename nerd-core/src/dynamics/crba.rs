//! The mass matrix, and forward dynamics by it.

use nalgebra::{DVector, Vector3};

use super::{Data, bias, inertias, tree::Inverse};
use crate::robot::Robot;

/// Mass matrix into `data.mass`, both triangles. Needs `kinematics`; fills `data.inertia`.
///
/// Composite rigid bodies: `M_ij = S_i . (I^c_j S_j)` for i an ancestor of j, with `I^c` the inertia of a subtree,
/// plus each joint's armature on the diagonal. Joints that follow one share its row and column, in which all their entries add up:
/// `G^T M G` with `G` the matrix that makes all joints' rates of the coordinates'.
pub fn crba(robot: &Robot, data: &mut Data) {
    let first = usize::from(robot.floating());
    data.mass.as_mut_slice().fill(0.0);
    inertias(robot, data);
    data.composite.copy_from_slice(&data.inertia);
    for (link, other) in data.stand_ins.iter().enumerate() {
        data.composite[link] = data.inertia[*other];
    }
    for j in (first..robot.links.len()).rev() {
        let link = &robot.links[j];
        let inertia = data.composite[j];
        let momentum = inertia.apply(&data.axis[j]);
        let row = data.dof[j];
        data.mass[(row, row)] +=
            data.axis[j].dot(&momentum) + link.joint.as_ref().map_or(0.0, |joint| joint.ratio().powi(2) * joint.armature);
        let mut ancestor = link.parent;
        while let Some(i) = ancestor {
            if robot.links[i].joint.is_some() {
                add(data, row, data.dof[i], data.axis[i].dot(&momentum));
            } else {
                for (k, value) in momentum.vector().iter().enumerate() {
                    add(data, row, k, *value);
                }
            }
            ancestor = robot.links[i].parent;
        }
        if let Some(p) = link.parent {
            data.composite[p] += inertia;
        }
    }
    if robot.floating() {
        data.mass.fixed_view_mut::<6, 6>(0, 0).copy_from(&data.composite[0].matrix());
    }
}

#[inline]
fn add(data: &mut Data, i: usize, j: usize, value: f64) {
    data.mass[(i, j)] += value;
    // On the diagonal, of a joint that follows one above it, both triangles meet.
    data.mass[(j, i)] += value;
}

/// Accelerations `M^-1 (tau - c)` into `data.qdd` for torques `tau` and local velocities `qd` (length `nv`). Needs
/// `kinematics`; honours `data.external`. Returns `false` if a subtree has no inertia to accelerate.
///
/// Articulated bodies, in O(n): the bias by [`bias`], the inverse by [`super::TreeFactor`].
#[must_use = "without inertia there is no acceleration"]
pub fn aba(robot: &Robot, qd: &[f64], tau: &[f64], gravity: &Vector3<f64>, data: &mut Data) -> bool {
    bias(robot, qd, gravity, data);
    let mut inverse = data.inverse.take().unwrap_or_else(|| Box::new(Inverse::new(robot)));
    let mut qdd = std::mem::replace(&mut data.qdd, DVector::zeros(0));
    qdd.iter_mut().zip(tau.iter().zip(data.tau.iter())).for_each(|(a, (tau, c))| *a = tau - c);
    let sound = match &mut *inverse {
        Inverse::Tree(tree) => {
            inertias(robot, data);
            let sound = tree.refill(robot, data, &[], &[]);
            if sound {
                tree.solve(robot, data, &[], qdd.as_mut_slice());
            }
            sound
        }
        Inverse::Matrix(factor) => {
            crba(robot, data);
            let sound = factor.refill(&data.mass);
            if sound {
                factor.solve(qdd.as_mut_slice());
            }
            sound
        }
    };
    (data.inverse, data.qdd) = (Some(inverse), qdd);
    sound
}
