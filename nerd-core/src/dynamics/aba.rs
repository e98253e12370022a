//! Forward dynamics.

use nalgebra::{Vector3, Vector6};

use super::{Data, Factor, bias, crba, inertias};
use crate::robot::Robot;
use crate::spatial::{Motion, Wrench};

/// Accelerations into `data.qdd` for torques `tau` and local velocities `qd` (length `nv`). Needs
/// `kinematics`; honours `data.external`. Returns `false` if a subtree has no inertia to accelerate.
///
/// Articulated-body algorithm: `qdd` from torques in O(n). With `U = I^A S`, `D = S . U + armature`, `u = tau - S . p`:
/// `I^A_p += I^A - U U^T / D`, `p_p += p + I^a c + U u / D`, then outward `qdd = (u - U . A') / D`. Where joints follow others, which
/// couples branches of the tree, by the mass matrix's factor instead.
#[must_use = "without inertia there is no acceleration"]
pub fn aba(robot: &Robot, qd: &[f64], tau: &[f64], gravity: &Vector3<f64>, data: &mut Data) -> bool {
    if let Some(factor) = data.factor.take() {
        return coupled(robot, qd, tau, gravity, data, factor);
    }
    let first = usize::from(robot.floating());
    inertias(robot, data);
    for (i, link) in robot.links.iter().enumerate() {
        let (mut v, mut c) = (Motion::default(), Motion::default());
        if link.joint.is_none() {
            v = Motion::from_slice(qd);
        } else {
            let rate = data.axis[i] * qd[data.dof[i]];
            v += link.parent.map_or(Motion::default(), |p| data.velocity[p]) + rate;
            c = v.cross(&rate);
        }
        (data.velocity[i], data.acceleration[i]) = (v, c);
        data.articulated[i] = data.inertia[i].matrix();
        data.force[i] = v.cross_wrench(&data.inertia[i].apply(&v)) - data.external[i];
    }
    for i in (first..robot.links.len()).rev() {
        let Some(joint) = &robot.links[i].joint else { continue };
        let s = data.axis[i].vector();
        let gain = data.articulated[i] * s;
        let pivot = s.dot(&gain) + joint.armature;
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        let residual = tau[data.dof[i]] - data.axis[i].dot(&data.force[i]);
        (data.gain[i], data.pivot[i], data.residual[i]) = (gain, pivot, residual);
        if let Some(p) = robot.links[i].parent {
            let inertia = data.articulated[i] - gain * gain.transpose() / pivot;
            let c = data.acceleration[i].vector();
            let passed = inertia * c + gain * (residual / pivot);
            data.articulated[p] += inertia;
            let f = data.force[i];
            data.force[p] += f + Wrench::from_slice(passed.as_slice());
        }
    }
    let base = Motion::new(Vector3::zeros(), -gravity);
    if robot.floating() {
        let mut wrench = Vector6::from_column_slice(&tau[..6]) - data.force[0].vector();
        let Some(factor) = data.articulated[0].cholesky() else { return false };
        factor.solve_mut(&mut wrench);
        // The solution is measured against free fall; the root's own acceleration adds gravity back.
        data.acceleration[0] = Motion::from_slice(wrench.as_slice());
        data.qdd.as_mut_slice()[..6].copy_from_slice(wrench.as_slice());
        for k in 0..3 {
            data.qdd[3 + k] += gravity[k];
        }
    }
    for i in first..robot.links.len() {
        let mut a = robot.links[i].parent.map_or(base, |p| data.acceleration[p]) + data.acceleration[i];
        let qdd = (data.residual[i] - data.gain[i].dot(&a.vector())) / data.pivot[i];
        a += data.axis[i] * qdd;
        data.acceleration[i] = a;
        data.qdd[data.dof[i]] = qdd;
    }
    true
}

/// `qdd = M^-1 (tau - c)`.
fn coupled(robot: &Robot, qd: &[f64], tau: &[f64], gravity: &Vector3<f64>, data: &mut Data, mut factor: Box<Factor>) -> bool {
    bias(robot, qd, gravity, data);
    crba(robot, data);
    let sound = factor.refill(&data.mass);
    if sound {
        data.qdd.iter_mut().zip(tau.iter().zip(data.tau.iter())).for_each(|(a, (tau, c))| *a = tau - c);
        factor.solve(data.qdd.as_mut_slice());
    }
    data.factor = Some(factor);
    sound
}
