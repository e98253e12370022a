//! The recursive Newton-Euler algorithm (RNEA): inverse dynamics and bias forces.

use super::adjoint::drag;
use super::motions;
use crate::prelude::*;

/// Writes the bias forces, which are the torques at zero acceleration, to `data.tau[nv]`. Needs `kinematics`; fills
/// `data.velocity` and `data.acceleration`. `qd[nv]` is in the local form (see [`super::to_local`]); `gravity` is in
/// m/s^2, world axes.
#[inline]
pub fn bias(robot: &Robot, qd: &[f64], gravity: &Vector3<f64>, data: &mut Data) {
    sweep::<false>(robot, qd, &[], gravity, data);
}

/// Writes the torques for the spatial accelerations `qdd[nv]` to `data.tau[nv]`. Other arguments are those of [`bias`].
///
/// `tau = M(q) qdd + c(q, qd) - J^T f_external`, with gravity as an upward acceleration of the base. `V_i = V_p + S_i
/// qd_i`, `A_i = A_p + S_i qdd_i + V_i x S_i qd_i`, `tau_i = S_i . sum of F over the subtree`. The wrench of a link is
/// `F_i = I_i A_i + V_i x* I_i V_i - f_i`. This wrench is computed from a force at the centre of mass c and a moment in
/// link axes, so the inertia is not rotated: `f = m (a + w_dot x c + w x (v + w x c))`, `n = R (I R^T w_dot + (R^T w) x
/// I R^T w) + c x f`. Gravity does not act on the gravity-compensated mass of a link. A floating root's damping resists
/// the root's motion. A joint's armature adds `armature qdd` to the joint's torque. The caller adds damping and limits
/// of joints.
#[inline]
pub fn rnea(robot: &Robot, qd: &[f64], qdd: &[f64], gravity: &Vector3<f64>, data: &mut Data) {
    sweep::<true>(robot, qd, qdd, gravity, data);
}

/// Writes the twists of all links to `data.velocity[link]`. Needs `kinematics`; `qd[nv]` is in the local form.
#[inline]
pub fn velocities(robot: &Robot, qd: &[f64], data: &mut Data) {
    let mut velocity = std::mem::take(&mut data.velocity);
    motions(robot, qd, data, &mut velocity);
    data.velocity = velocity;
}

#[inline]
fn sweep<const ACCELERATED: bool>(robot: &Robot, qd: &[f64], qdd: &[f64], gravity: &Vector3<f64>, data: &mut Data) {
    let base = Motion::new(Vector3::zeros(), -gravity);
    let links = &robot.links[..];
    let n = robot.links.len();
    // Slices of the same length as the links let the compiler drop bounds checks.
    let dof = &data.dof[..n];
    let axis = &data.axis[..n];
    let rotation = &data.rotation[..n];
    let position = &data.position[..n];
    let external = &data.external[..n];
    let force = &mut data.force[..n];
    let velocity = &mut data.velocity[..n];
    let acceleration = &mut data.acceleration[..n];
    for i in 0..n {
        let link = &links[i];
        let (v, a) = if link.joint.is_none() {
            (Motion::from_slice(qd), if ACCELERATED { base + Motion::from_slice(qdd) } else { base })
        } else {
            let (v, a) = link.parent.map_or((Motion::default(), base), |p| (velocity[p], acceleration[p]));
            let rate = axis[i] * qd[dof[i]];
            let v = v + rate;
            let a = a + v.cross(&rate);
            (v, if ACCELERATED { a + axis[i] * qdd[dof[i]] } else { a })
        };
        (velocity[i], acceleration[i]) = (v, a);
        let r = &rotation[i];
        let body = &link.inertia;
        let c = position[i] + r * body.com;
        let f = (a.at(&c) + v.ang.cross(&v.at(&c))) * body.mass;
        let (w, w_dot) = (r.tr_mul(&v.ang), r.tr_mul(&a.ang));
        let n = r * (body.inertia * w_dot + w.cross(&(body.inertia * w))) + c.cross(&f);
        force[i] = Wrench::new(n, f) - external[i];
        if link.lifted.mass != 0.0 {
            force[i] += Wrench::force_at(gravity * link.lifted.mass, &(position[i] + r * link.lifted.at));
        }
        if link.joint.is_none() && robot.free.damping != 0.0 {
            force[i] += drag(robot, &v, &position[i]);
        }
    }
    // Mimic joints add to the torque of the coordinate that they follow.
    let tau = data.tau.as_mut_slice();
    tau.fill(0.0);
    for i in (0..n).rev() {
        let link = &links[i];
        let f = force[i];
        match &link.joint {
            None => tau[..6].copy_from_slice(f.vector().as_slice()),
            Some(joint) => {
                tau[dof[i]] += axis[i].dot(&f);
                if ACCELERATED {
                    tau[dof[i]] += joint.ratio().powi(2) * joint.armature * qdd[dof[i]];
                }
            }
        }
        if let Some(p) = link.parent {
            force[p] += f;
        }
    }
}
