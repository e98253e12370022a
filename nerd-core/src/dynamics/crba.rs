//! The composite-rigid-body algorithm (CRBA): the mass matrix.

use super::{Data, inertias};
use crate::robot::Robot;

/// Writes the mass matrix (`nv` by `nv`, both triangles) to `data.mass`. Needs `kinematics`; fills `data.inertia`.
///
/// `M_ij = S_i . (I^c_j S_j)` for link i an ancestor of link j, with `I^c` the composite inertia of a subtree. Each
/// joint's armature adds to the diagonal. A mimic joint adds to the row and column of the coordinate that it follows.
/// That gives `G^T M G`, where G maps the rates of the coordinates to the rates of all joints.
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
        data.mass[(row, row)] += data.axis[j].dot(&momentum)
            + link.joint.as_ref().map_or(0.0, |joint| joint.ratio().powi(2) * joint.armature);
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
    // If a mimic joint and an ancestor share one coordinate, both triangles are this diagonal entry, which gets `value`
    // twice.
    data.mass[(j, i)] += value;
}
