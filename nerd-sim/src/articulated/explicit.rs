//! A frame of explicit substeps: symplectic Euler, or Runge-Kutta without contact.

use nerd_core::dynamics::{bias, crba, kinematics_about, move_twist, root_position, to_local, to_world, velocities};

use super::{config::Asked, force::force, workspace::Workspace};
use crate::prelude::*;
use crate::solver::gone;

/// Margin (m) of contact queries that serve a whole frame, added to twice the distance that a point covers in the
/// frame.
const QUERY_MARGIN: f64 = 0.1;

impl Workspace {
    /// Steps a frame explicitly; `false` if a joint or a friction was too stiff.
    pub(super) fn explicit(&mut self, asked: &Asked, state: &mut [f64]) -> Result<bool, String> {
        let Asked { system, scene, config, contact, .. } = *asked;
        let robot = &system.robot;
        let substeps = if contact { config.contact_substeps } else { config.substeps };
        let dt = system.frame_time / substeps as f64;
        let (q, qd) = state.split_at_mut(robot.nq());
        if !contact && config.integrator == Integrator::Rk4 {
            to_local(robot, q, qd);
            for _ in 0..substeps {
                if !self.runge_kutta(asked, state, dt)? {
                    return Ok(false);
                }
            }
            let (q, qd) = state.split_at_mut(robot.nq());
            to_world(robot, q, qd);
            return Ok(true);
        }
        // The origin stays at the root's first position throughout the frame, so a kept mass matrix and the forces have
        // the same origin. The motion does not depend on a fixed origin; the reference takes the world's.
        let origin = root_position(robot, q);
        move_twist(robot, &origin, qd);
        for substep in 0..substeps {
            let renew = substep == 0 || config.refresh == Refresh::Substep;
            kinematics_about(robot, q, &origin, &mut self.data);
            if contact {
                // A plane stays the same throughout a frame. With `Refresh::Frame` other shapes are queried once a
                // frame and held as tangent planes, as in the reference. With `Refresh::Substep` all shapes are queried
                // in every substep.
                if renew {
                    let held = config.refresh == Refresh::Frame;
                    let (time, margin) = if held { (2.0 * system.frame_time, QUERY_MARGIN) } else { (0.0, 0.0) };
                    self.query(system, scene, qd, time, margin).map_err(|lost| gone(system, q).unwrap_or(lost))?;
                }
                if !self.contact_wrenches(asked, qd, dt, 1.0 / substeps as f64) {
                    return Ok(false);
                }
            }
            if !self.accelerate(asked, q, qd, renew, (dt, Integrator::SymplecticEuler))? {
                return Ok(false);
            }
            euler(robot, q, qd, self.data.qdd.as_slice(), &origin, dt);
        }
        move_twist(robot, &-origin, qd);
        Ok(true)
    }

    /// Writes contact wrenches to `data.external`, and adds their forces, times `share`, to the frame's mean forces.
    /// `false` if a friction is too stiff for a substep of `dt`.
    fn contact_wrenches(&mut self, asked: &Asked, qd: &[f64], dt: f64, share: f64) -> bool {
        let Asked { system, scene, config, .. } = *asked;
        let robot = &system.robot;
        self.data.external.fill(Wrench::default());
        let origin = self.data.origin;
        let mut moving = false;
        for (owner, event) in self.owners.iter().zip(&self.events) {
            let point = &robot.contact_points[*owner];
            let n = &event.normal;
            let rotation = &self.data.rotation[point.link];
            let p0 = self.data.position[point.link] + rotation * point.facing(rotation, n);
            let Some(material) = self.materials.of(system, point, &scene.colliders[event.collider], event.collider)
            else {
                continue;
            };
            let gap = n.dot(&(p0 - (event.p1 - origin))) - point.radius - material.margin;
            if gap < 0.0 {
                if !moving {
                    velocities(robot, qd, &mut self.data);
                    moving = true;
                }
                // Torsional and rolling friction stick, so they need the implicit step, as dry friction does.
                if material.torsion > 0.0
                    || material.rolling > 0.0
                    || self.stiff.drags(*owner, material.friction_damping, dt)
                {
                    return false;
                }
                let x = p0 - n * point.radius;
                let v = self.data.velocity[point.link].at(&x);
                let f = force(gap, n, &v, &material, config.friction);
                self.data.external[point.link] += Wrench::force_at(f, &x);
                self.forces[*owner] += f * share;
            }
        }
        true
    }

    /// `data.qdd = M^-1 (tau + limits - damping - bias)`; `false` if a joint is too stiff for a substep of `dt`.
    fn accelerate(
        &mut self,
        asked: &Asked,
        q: &[f64],
        qd: &[f64],
        renew: bool,
        (dt, by): (f64, Integrator),
    ) -> Result<bool, String> {
        let Asked { system: System { robot, .. }, scene, tau, .. } = *asked;
        if renew {
            crba(robot, &mut self.data);
            if !self.factor.refill(&self.data.mass) {
                return Err(self.factor.fault(robot));
            }
        }
        if self.stiff.dampers(robot, &self.factor, dt) {
            return Ok(false);
        }
        bias(robot, qd, &scene.gravity, &mut self.data);
        let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
        for k in 0..dofs {
            self.data.qdd[k] = -self.data.tau[k];
        }
        self.stiff.clear();
        for (i, joint) in robot.joints().enumerate() {
            let (x, v) = (q[coords + i], qd[dofs + i]);
            let limit = joint.limit.map_or(0.0, |l| {
                let force = l.force(x, v);
                if force != 0.0 {
                    self.stiff.beyond(i, &l, dt);
                }
                force
            });
            self.data.qdd[dofs + i] = tau[i] + limit - joint.damping * v - self.data.tau[dofs + i];
        }
        if self.stiff.limits(robot, &self.factor, dt, by) {
            return Ok(false);
        }
        self.factor.solve(self.data.qdd.as_mut_slice());
        Ok(true)
    }

    /// Steps (q, qd) by classical Runge-Kutta with the derivatives of [`rate`], then normalises a floating root's
    /// quaternion. `false` if a joint was too stiff.
    fn runge_kutta(&mut self, asked: &Asked, state: &mut [f64], dt: f64) -> Result<bool, String> {
        let robot = &asked.system.robot;
        for (k, at) in [0.0, 0.5, 0.5, 1.0].into_iter().enumerate() {
            self.trial.copy_from_slice(state);
            if k > 0 {
                self.trial.iter_mut().zip(&self.rates[k - 1]).for_each(|(x, r)| *x += at * dt * r);
            }
            let mut trial = std::mem::take(&mut self.trial);
            let (q, qd) = trial.split_at_mut(robot.nq());
            kinematics(robot, q, &mut self.data);
            let done = self.accelerate(asked, q, qd, true, (dt, Integrator::Rk4));
            rate(robot, q, qd, self.data.qdd.as_slice(), &mut self.rates[k]);
            if let Some(kept) = &mut self.kept {
                kept.flown(&trial, &self.rates[k], &mut self.data, &mut self.factor);
            }
            self.trial = trial;
            if !done? {
                return Ok(false);
            }
        }
        for (weight, rates) in [1.0, 2.0, 2.0, 1.0].into_iter().zip(&self.rates) {
            state.iter_mut().zip(rates).for_each(|(x, r)| *x += weight / 6.0 * dt * r);
        }
        if robot.floating() {
            let unit = quaternion(&state[3..7]);
            write_quaternion(&mut state[3..7], &unit);
        }
        Ok(true)
    }
}

/// Time derivative of (q, qd) in local velocities: `p_ddot = a + w x p_dot`, `Q_dot = (w, 0) Q / 2`.
fn rate(robot: &Robot, q: &[f64], qd: &[f64], qdd: &[f64], out: &mut [f64]) {
    let dofs = robot.root_dofs();
    let coords = robot.root_coords();
    let nq = robot.nq();
    out[coords..nq].copy_from_slice(&qd[dofs..]);
    out[nq..].copy_from_slice(qdd);
    if robot.floating() {
        let (w, v) = (vector(&qd[..3]), vector(&qd[3..6]));
        out[..3].copy_from_slice(v.as_slice());
        let spin = nalgebra::Quaternion::from_imag(w) * raw_quaternion(&q[3..]) * 0.5;
        out[3..7].copy_from_slice(spin.coords.as_slice());
        out[nq + 3..nq + 6].copy_from_slice((vector(&qdd[3..6]) + w.cross(&v)).as_slice());
    }
}

/// Steps (q, qd) by symplectic Euler over `dt` (s). A floating root's twist is about `origin`:
/// `p_dot = v + w x (p - origin)`.
#[inline]
fn euler(robot: &Robot, q: &mut [f64], qd: &mut [f64], qdd: &[f64], origin: &Vector3<f64>, dt: f64) {
    qd.iter_mut().zip(qdd).for_each(|(v, a)| *v += a * dt);
    let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
    for (x, v) in q[coords..].iter_mut().zip(&qd[dofs..]) {
        *x += v * dt;
    }
    if robot.floating() {
        let (w, v, p) = (vector(&qd[..3]), vector(&qd[3..6]), vector(&q[..3]));
        q[..3].copy_from_slice((p + (v + w.cross(&(p - origin))) * dt).as_slice());
        let r = quaternion(&q[3..7]);
        let turned = r.quaternion() + nalgebra::Quaternion::from_imag(w * (0.5 * dt)) * r.quaternion();
        write_quaternion(&mut q[3..7], &UnitQuaternion::new_normalize(turned));
    }
}
