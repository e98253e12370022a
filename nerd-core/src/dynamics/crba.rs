//! The mass matrix.

use nalgebra::Vector3;

use super::{Data, inertias};
use crate::robot::Robot;
use crate::spatial::Motion;

/// Mass matrix into `data.mass`, both triangles. Needs [`super::kinematics`]; fills `data.inertia`.
///
/// Composite rigid bodies: `M_ij = S_i . (I^c_j S_j)` for i an ancestor of j, with `I^c` the inertia of a subtree,
/// plus each joint's armature on the diagonal.
pub fn crba(robot: &Robot, data: &mut Data) {
    let (dofs, first) = (robot.root_dofs(), usize::from(robot.floating()));
    data.mass.fill(0.0);
    inertias(robot, data);
    data.composite.copy_from_slice(&data.inertia);
    for (link, other) in robot.mass_matrix_of.iter().enumerate() {
        data.composite[link] = data.inertia[*other];
    }
    for j in (first..robot.links.len()).rev() {
        let link = &robot.links[j];
        let inertia = data.composite[j];
        let momentum = inertia.apply(&data.axis[j]);
        let row = dofs + j - first;
        data.mass[(row, row)] = data.axis[j].dot(&momentum) + link.joint.as_ref().map_or(0.0, |joint| joint.armature);
        let mut ancestor = link.parent;
        while let Some(i) = ancestor {
            if robot.links[i].joint.is_some() {
                set(data, row, dofs + i - first, data.axis[i].dot(&momentum));
            } else {
                for k in 0..6 {
                    set(data, row, k, unit(k).dot(&momentum));
                }
            }
            ancestor = robot.links[i].parent;
        }
        if let Some(p) = link.parent {
            data.composite[p] += inertia;
        }
    }
    if robot.floating() {
        for k in 0..6 {
            let momentum = data.composite[0].apply(&unit(k));
            for l in 0..6 {
                data.mass[(l, k)] = unit(l).dot(&momentum);
            }
        }
    }
}

#[inline]
fn set(data: &mut Data, i: usize, j: usize, value: f64) {
    data.mass[(i, j)] = value;
    data.mass[(j, i)] = value;
}

/// The k-th unit motion.
#[inline]
fn unit(k: usize) -> Motion {
    let mut m = Motion::default();
    if k < 3 {
        m.ang = Vector3::ith(k, 1.0)
    } else {
        m.lin = Vector3::ith(k - 3, 1.0)
    }
    m
}
