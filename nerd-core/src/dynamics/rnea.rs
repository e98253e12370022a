//! Inverse dynamics.

use super::adjoint::drag;
use super::motions;
use crate::prelude::*;

/// Torques at zero acceleration, into `data.tau`. Needs `kinematics`; fills `data.velocity`.
/// `qd` is local (see [`super::to_local`]), length `nv`; `gravity` in m/s^2, world axes.
#[inline]
pub fn bias(robot: &Robot, qd: &[f64], gravity: &Vector3<f64>, data: &mut Data) {
    sweep::<false>(robot, qd, &[], gravity, data);
}

/// Torques for accelerations `qdd` (length `nv`), into `data.tau`; otherwise as [`bias`].
///
/// Recursive Newton-Euler: `tau = M(q) qdd + c(q, qd) - J^T f_external`, with gravity as an upward acceleration of
/// the base. `V_i = V_p + S_i qd_i`, `A_i = A_p + S_i qdd_i + V_i x S_i qd_i`, `tau_i = S_i . sum of F over the
/// subtree`. The wrench `F_i = I_i A_i + V_i x* I_i V_i - f_i` of a link is computed in Newton-Euler form, force at the centre of mass c
/// and moment in link axes, so that the inertia need not be rotated into world axes:
/// `f = m (a + w_dot x c + w x (v + w x c))`, `n = R (I R^T w_dot + (R^T w) x I R^T w) + c x f`.
/// The gravity-compensated mass of a link has no weight; a free root's damping resists. A joint's armature adds `armature qdd`. Its damping
/// and limits are left to the caller: they are forces of the joint, not of the tree.
#[inline]
pub fn rnea(robot: &Robot, qd: &[f64], qdd: &[f64], gravity: &Vector3<f64>, data: &mut Data) {
    sweep::<true>(robot, qd, qdd, gravity, data);
}

/// Twists of all links into `data.velocity`. Needs `kinematics`; `qd` local.
#[inline]
pub fn velocities(robot: &Robot, qd: &[f64], data: &mut Data) {
    let mut velocity = std::mem::take(&mut data.velocity);
    motions(robot, qd, data, &mut velocity);
    data.velocity = velocity;
}

#[inline]
fn sweep<const ACCELERATED: bool>(robot: &Robot, qd: &[f64], qdd: &[f64], gravity: &Vector3<f64>, data: &mut Data) {
    let base = Motion::new(Vector3::zeros(), -gravity);
    let (links, n) = (&robot.links[..], robot.links.len());
    // As long as the links, so that the compiler sees an index within the links as within these.
    let (dof, axis, rotation, position) = (&data.dof[..n], &data.axis[..n], &data.rotation[..n], &data.position[..n]);
    let (external, force) = (&data.external[..n], &mut data.force[..n]);
    let (velocity, acceleration) = (&mut data.velocity[..n], &mut data.acceleration[..n]);
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
        let (r, body) = (&rotation[i], &link.inertia);
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
    // Joints that follow a coordinate add to its torque.
    let tau = data.tau.as_mut_slice();
    tau.fill(0.0);
    for i in (0..n).rev() {
        let (link, f) = (&links[i], force[i]);
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
