//! A substep h of second order, with contact, limits and joint damping looking ahead so that it is stable at any length.
//!
//! Half a drift, a kick with the forces found there, half a drift (leapfrog). A spring, damper or friction of a touch sees
//! the velocity `v + a (v' - v)` between the substep's start and its end, and a spring the gap `g + a h (v' - v)`, each with
//! its own share a: none for a spring and half for a damper while that is stable, more as they grow stiff for the touch's
//! own inertia, `1 / w = 1 / n^T J M^-1 J^T n`:
//!
//! ```text
//! spring a = max(0, 1/2 - 1 / (2 h^2 k w))      damper a = max(1/2, 1 - 1 / (h d w))      (friction's drag likewise)
//! (M + h sum J^T D J) qdd = tau - bias + sum J^T f,    D = (a_k h k + a_d d) n n^T + a_c c (1 - n n^T)
//! f = -(k g + d min(v_n, 0)) n - c v_t
//! ```
//!
//! The gap g is the mean over that part of the substep in which the point is inside, and k, d, c act with that part only,
//! so that it matters little where in a substep a point lands. The drag c is the law's at the velocity seen, found by
//! repetition. A point that would pull has parted; it is dropped and the system solved again. A joint beyond its limit is a
//! touch without friction that may pull, its own damper one that always acts, with the share that makes a damper alone
//! exact, `a = 1 / (1 - exp(-z)) - 1 / z`, where `z = h d w` is beyond 1; a joint's dry friction is one that rubs under a constant force, and holds up to
//! 1 mm/s of creep. A drive ([`crate::drive`]) is one that may pull, until its effort holds it at a constant force. A touch couples only the joints above it, so the matrix keeps the tree's zeros and
//! the factorisation its cost.

use nalgebra::{UnitQuaternion, Vector3};
use nerd_core::dynamics::{bias, crba, kinematics, to_local, to_world};
use nerd_core::robot::Robot;
use nerd_core::state::{quaternion, vector, write_quaternion};

use super::force::drag;
use super::frame::Workspace;
use super::touches::Touches;
use super::{ArticulatedConfig, Friction};
use crate::scene::Scene;
use crate::solver::gone;
use crate::system::System;

/// Solves of a substep at most.
const PASSES: usize = 6;
/// Change of a drag, relative, that asks for no other solve, over the substeps of a frame: finer substeps, finer drags.
const SETTLED: f64 = 0.02;

impl Workspace {
    /// A frame of so many substeps; contacts are looked for in each, or `held` as they were found before.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn implicit(
        &mut self,
        system: &System,
        scene: &Scene,
        config: &ArticulatedConfig,
        substeps: usize,
        held: bool,
        state: &mut [f64],
        tau: &[f64],
    ) -> Result<(), String> {
        let robot = &system.robot;
        let h = system.frame_time / substeps as f64;
        let (q, qd) = state.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        self.touches.begin(robot, scene);
        for substep in 0..substeps {
            drift(robot, q, qd, 0.5 * h);
            kinematics(robot, q, &mut self.data);
            if !held {
                self.query(system, scene, qd, h, 0.0).map_err(|lost| gone(system, q).unwrap_or(lost))?;
            }
            self.find(robot, scene, q, qd, h);
            crba(robot, &mut self.data);
            if substep == 0 {
                self.damp(robot, h)?;
            }
            self.weigh(robot, h, config.friction)?;
            // The first substep of a frame knows no rate yet, and finds its middle by a second solve.
            if substep == 0 {
                self.touches.rate.fill(0.0);
            }
            self.accelerate_ahead(robot, scene, qd, tau, h, substep == 0, SETTLED / substeps as f64, config.friction)?;
            qd.iter_mut().zip(&self.touches.rate).for_each(|(v, a)| *v += h * a);
            self.touches.tell(scene, 1.0 / substeps as f64, &mut self.forces);
            drift(robot, q, qd, 0.5 * h);
        }
        to_world(robot, q, qd);
        Ok(())
    }

    /// Shares of the joints' own dampers.
    fn damp(&mut self, robot: &Robot, h: f64) -> Result<(), String> {
        let Touches { dampers, right, .. } = &mut self.touches;
        let mut factored = false;
        for (i, (joint, share)) in robot.joints().zip(dampers).enumerate() {
            *share = 0.5;
            if h * joint.damping <= self.stiff.bounds.least[i] {
                continue;
            }
            if !factored && !self.factor.refill(&self.data.mass) {
                return Err(self.factor.fault(robot));
            }
            factored = true;
            let k = robot.root_dofs() + i;
            right.fill(0.0);
            right[k] = 1.0;
            self.factor.solve(right);
            *share = exponential(h * joint.damping * right[k]);
        }
        Ok(())
    }

    /// How far ahead each force must look to be stable, from the touch's own inertia `1 / w = 1 / n^T J M^-1 J^T n`.
    fn weigh(&mut self, robot: &Robot, h: f64, friction: Friction) -> Result<(), String> {
        let Touches { touches, columns, weights, right, .. } = &mut self.touches;
        let mut factored = false;
        for touch in touches.iter_mut() {
            let columns = &columns[touch.columns.clone()];
            if weights[touch.index].is_none() {
                if !factored && !self.factor.refill(&self.data.mass) {
                    return Err(self.factor.fault(robot));
                }
                factored = true;
                right.fill(0.0);
                // Joints that follow one share its column.
                columns.iter().for_each(|(k, a)| right[*k] += touch.normal.dot(a));
                self.factor.solve(right);
                // What only rubs, as dry friction does, always looks all the way ahead.
                let w: f64 = columns.iter().map(|(k, a)| right[*k] * touch.normal.dot(a)).sum();
                weights[touch.index] = Some(if w > 0.0 { w } else { f64::INFINITY });
            }
            let Some(w) = weights[touch.index] else { continue };
            let vn = touch.normal.dot(&touch.velocity);
            if vn >= 0.0 && !touch.sticky {
                touch.material.damping = 0.0;
            }
            let m = &touch.material;
            let damper = |d: f64| (1.0 - 1.0 / (h * d * w)).max(0.5);
            let normal = (-(m.stiffness * touch.gap + m.damping * vn)).max(0.0);
            touch.across = drag(normal, (touch.velocity - touch.normal * vn).norm(), m, friction);
            touch.ahead = [(0.5 - 0.5 / (h * h * m.stiffness * w)).max(0.0), damper(m.damping), damper(touch.across)];
        }
        Ok(())
    }

    /// `rate`, the change of local velocities over h, from forces in the substep's middle.
    #[allow(clippy::too_many_arguments)]
    fn accelerate_ahead(
        &mut self,
        robot: &Robot,
        scene: &Scene,
        qd: &[f64],
        tau: &[f64],
        h: f64,
        correct: bool,
        settled: f64,
        friction: Friction,
    ) -> Result<(), String> {
        let dofs = robot.root_dofs();
        for (i, (joint, share)) in robot.joints().zip(&self.touches.dampers).enumerate() {
            self.data.mass[(dofs + i, dofs + i)] += share * h * joint.damping;
        }
        self.touches.mass.copy_from(&self.data.mass);
        let (mut stale, mut correct) = (true, correct);
        for _ in 0..PASSES {
            let Touches { middle, rate, right, .. } = &mut self.touches;
            if stale {
                middle.iter_mut().zip(qd.iter().zip(rate.iter())).for_each(|(m, (v, a))| *m = v + 0.5 * h * a);
                bias(robot, middle, &scene.gravity, &mut self.data);
                right.iter_mut().zip(self.data.tau.iter()).for_each(|(r, t)| *r = -t);
                for (i, joint) in robot.joints().enumerate() {
                    right[dofs + i] += tau[i] - joint.damping * qd[dofs + i];
                }
            }
            let changed = self.solve(robot, h, settled, friction)?;
            let Touches { middle, rate, .. } = &mut self.touches;
            rate.copy_from_slice(self.data.qdd.as_slice());
            if robot.floating() {
                // The derivative of a velocity that moves along is the spatial acceleration and w x v.
                let turn = vector(&middle[..3]).cross(&vector(&middle[3..6]));
                (0..3).for_each(|k| rate[3 + k] += turn[k]);
            }
            if !changed && !correct {
                break;
            }
            stale = correct;
            correct = false;
        }
        Ok(())
    }

    /// Accelerations with the touches that have not parted. Then each one's drag is that of its force and slip at the
    /// end, and a point that would pull has parted; whether that changes anything.
    fn solve(&mut self, robot: &Robot, h: f64, settled: f64, friction: Friction) -> Result<bool, String> {
        let Touches { touches, columns, mass, right, .. } = &mut self.touches;
        self.data.mass.copy_from(mass);
        self.data.qdd.as_mut_slice().copy_from_slice(right);
        for touch in touches.iter().filter(|t| !t.parted) {
            let (n, m, [spring, damper, slide]) = (&touch.normal, &touch.material, touch.ahead);
            let vn = n.dot(&touch.velocity);
            if let Some(force) = touch.held {
                columns[touch.columns.clone()].iter().for_each(|(i, a)| self.data.qdd[*i] += a.dot(n) * force);
                continue;
            }
            let force = n * -(m.stiffness * touch.gap + m.damping * vn) - (touch.velocity - n * vn) * touch.across;
            let (along, across) = (spring * h * m.stiffness + damper * m.damping, slide * touch.across);
            for (i, a) in &columns[touch.columns.clone()] {
                self.data.qdd[*i] += a.dot(&force);
                // h D a
                let d = (n * ((along - across) * n.dot(a)) + a * across) * h;
                for (j, b) in &columns[touch.columns.clone()] {
                    self.data.mass[(*i, *j)] += b.dot(&d);
                }
            }
        }
        if !self.factor.refill(&self.data.mass) {
            return Err(self.factor.fault(robot));
        }
        self.factor.solve(self.data.qdd.as_mut_slice());
        let mut changed = false;
        for touch in touches.iter_mut().filter(|t| !t.parted && t.held.is_none() && (!t.sticky || t.bounds.is_some())) {
            let (n, m, [spring, damper, slide]) = (&touch.normal, &touch.material, touch.ahead);
            let change: Vector3<f64> = columns[touch.columns.clone()].iter().map(|(k, a)| a * (h * self.data.qdd[*k])).sum();
            let (vn, dn) = (n.dot(&touch.velocity), n.dot(&change));
            let normal = -(m.stiffness * (touch.gap + spring * h * dn) + m.damping * (vn + damper * dn));
            if let Some([least, most]) = touch.bounds {
                touch.held = (!(least..=most).contains(&normal)).then(|| normal.clamp(least, most));
                changed |= touch.held.is_some();
                continue;
            }
            touch.parted = normal < 0.0;
            let seen = touch.velocity + change * slide;
            let slip = seen - n * n.dot(&seen);
            touch.force = if touch.parted { Vector3::zeros() } else { n * normal - slip * touch.across };
            let across = drag(normal.max(0.0), slip.norm(), m, friction);
            changed |= touch.parted || (across / touch.across - 1.0).abs() > settled;
            touch.across = across;
        }
        Ok(changed)
    }
}

/// The share of a damper with `z = h d w` beyond 1 that makes its decay, `1 - z / (1 + a z)`, exact: `exp(-z)`.
fn exponential(z: f64) -> f64 {
    if z > 1.0 { -1.0 / (-z).exp_m1() - 1.0 / z } else { 0.5 }
}

/// The pose after a time at local velocities.
fn drift(robot: &Robot, q: &mut [f64], qd: &[f64], time: f64) {
    let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
    for (x, v) in q[coords..].iter_mut().zip(&qd[dofs..]) {
        *x += v * time;
    }
    if robot.floating() {
        let (w, v) = (vector(&qd[..3]), vector(&qd[3..6]));
        let p = vector(&q[..3]) + v * time;
        q[..3].copy_from_slice(p.as_slice());
        let turned = UnitQuaternion::from_scaled_axis(w * time) * quaternion(&q[3..7]);
        write_quaternion(&mut q[3..7], &turned);
    }
}
