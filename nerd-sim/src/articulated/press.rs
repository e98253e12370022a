//! Contacts in the matrix of a solve: their columns, forces and resistances.

use nalgebra::DVector;

use super::{along::Tree, touch::Contact};
use crate::prelude::*;

/// Change (m/s) `h J qdd` of a contact's velocity in the last solution.
#[inline]
pub(super) fn moved(
    contact: &Contact,
    columns: &[(usize, Vector3<f64>)],
    tree: Option<&Tree>,
    qdd: &DVector<f64>,
    h: f64,
) -> Vector3<f64> {
    match tree {
        Some(tree) => tree.at(contact.link, &contact.x) * h,
        None => columns[contact.columns.clone()].iter().map(|(k, a)| a * (h * qdd[*k])).sum(),
    }
}

/// Adds a contact's force to `data.qdd`, and its resistance `h D` to the lower triangle of `data.mass`.
#[inline]
pub(super) fn press(data: &mut Data, contact: &Contact, columns: &[(usize, Vector3<f64>)], h: f64) {
    let n = &contact.normal;
    let (force, along, across) = contact.push(h);
    for (i, a) in columns {
        data.qdd[*i] += a.dot(&force);
        // h D a
        let d = (n * ((along - across) * n.dot(a)) + a * across) * h;
        for (j, b) in columns.iter().filter(|(j, _)| j <= i) {
            data.mass[(*i, *j)] += b.dot(&d);
        }
    }
}

/// Adds torques of torsional and rolling friction to `data.qdd`, and their resistance to the lower triangle of
/// `data.mass`.
pub(super) fn press_turns(robot: &Robot, data: &mut Data, contact: &Contact, h: f64) {
    let turning = &contact.turning;
    let n = &contact.normal;
    let torque = turning.resists(n, &(turning.spin - turning.turn_offset));
    let Data { dof, axis, qdd, mass, .. } = data;
    for (i, a) in turns(robot, (dof, axis), contact.link) {
        qdd[i] += a.dot(&torque);
        let resists = -turning.resists(n, &a) * h;
        for (j, b) in turns(robot, (dof, axis), contact.link).filter(|(j, _)| *j <= i) {
            mass[(i, j)] += b.dot(&resists);
        }
    }
}

/// Columns of the Jacobian of a link's angular velocity, each with its DoF.
pub(super) fn turns<'a>(
    robot: &'a Robot,
    (dof, axis): (&'a [usize], &'a [Motion]),
    link: usize,
) -> impl Iterator<Item = (usize, Vector3<f64>)> + 'a {
    robot.ancestors(link).flat_map(move |i| {
        let own = robot.links[i].joint.is_some();
        (0..if own { 1 } else { 3 }).map(move |k| if own { (dof[i], axis[i].ang) } else { (k, Vector3::ith(k, 1.0)) })
    })
}
