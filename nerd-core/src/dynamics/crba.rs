//! The composite-rigid-body algorithm (CRBA): the mass matrix.

use super::{Data, inertias};
use crate::robot::Robot;

/// Mass matrix (`nv` by `nv`) into `data.mass`, both triangles. Needs `kinematics`; fills `data.inertia`.
///
/// `M_ij = S_i . (I^c_j S_j)` for i an ancestor of j, with `I^c` the composite inertia of a subtree. Each joint's
/// armature adds to the diagonal. Mimic joints add to the row and column of their coordinate: `G^T M G`, where G maps
/// the rates of the coordinates to the rates of all joints.
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
    // For a mimic joint and an ancestor of the same coordinate, both triangles add to the diagonal.
    data.mass[(j, i)] += value;
}
