//! The mass matrix.

use super::{Data, inertias};
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
