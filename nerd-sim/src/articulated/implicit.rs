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
//! 1 mm/s of creep. A joint's spring, `z = h^2 k w`, is damped by `h k min(z, 1/2)` at least: what a substep is too long to follow would ring for
//! ever, and shake what it can follow. That is of third order in h, and nothing beside a damper that lets the spring come to rest. A drive ([`crate::drive`]) is one that may pull, until its effort holds it at a constant force. A touch couples only the joints above it, so the matrix keeps the tree's zeros and
//! the factorisation its cost. Where chains are long, the same equations are solved along the tree (`along.rs`).

use nalgebra::{DVector, UnitQuaternion, Vector3};
use nerd_core::dynamics::{bias, crba, kinematics, to_local, to_world};
use nerd_core::robot::Robot;
use nerd_core::state::{quaternion, vector, write_quaternion};

use super::along::Tree;
use super::force::drag;
use super::frame::Workspace;
use super::touches::Touches;
use super::{ArticulatedConfig, Friction};
use crate::scene::Scene;
use crate::solver::gone;
use crate::system::System;

/// Solves of a substep at most.
pub(super) const PASSES: usize = 6;
/// Change of a drag, relative, that asks for no other solve, over the substeps of a frame: finer substeps, finer drags.
pub(super) const SETTLED: f64 = 0.02;

/// Largest share of `h k` by which a joint's spring is damped.
pub(super) const CALM: f64 = 0.5;
/// Change of a joint's way over half a substep (rad or m), by what its rate was thought to be, that asks for another solve; and after that
/// solve, for shorter substeps. Of chains alone.
pub(super) const OFF: f64 = 1e-3;
pub(super) const LOST: f64 = 1e-2;
/// How often a substep is halved at most.
pub(super) const HALVINGS: usize = 6;

/// What a substep of length h (s) is made of.
#[derive(Clone, Copy)]
struct Substep<'a> {
    system: &'a System,
    scene: &'a Scene,
    config: &'a ArticulatedConfig,
    /// Whether contacts are held as they were found.
    held: bool,
    /// See [`SETTLED`].
    settled: f64,
    tau: &'a [f64],
    h: f64,
}

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
        let (q, qd) = state.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        self.touches.begin(robot, scene);
        let all = Substep { system, scene, config, held, settled: SETTLED / substeps as f64, tau, h: system.frame_time / substeps as f64 };
        for substep in 0..substeps {
            self.substep(&all, substep == 0, HALVINGS, q, qd)?;
        }
        to_world(robot, q, qd);
        Ok(())
    }

    /// One substep, in halves if it is too long to be solved.
    fn substep(&mut self, own: &Substep, first: bool, halvings: usize, q: &mut [f64], qd: &mut [f64]) -> Result<(), String> {
        let Substep { system, scene, config, held, h, .. } = *own;
        let robot = &system.robot;
        let half = 0.5 * h;
        if self.touches.tree.is_some() {
            self.touches.before.copy_from_slice(q);
        }
        drift(robot, q, qd, half);
        kinematics(robot, q, &mut self.data);
        if !held {
            self.query(system, scene, qd, h, 0.0).map_err(|lost| gone(system, q).unwrap_or(lost))?;
        }
        self.find(robot, scene, q, qd, h);
        match self.touches.tree {
            Some(_) => Tree::begin(robot, &mut self.data),
            None => crba(robot, &mut self.data),
        }
        if self.touches.shared != h {
            self.damp(robot, h)?;
        }
        self.weigh(robot, h, config.friction)?;
        // The first substep of a frame knows no rate yet, and finds its middle by a second solve.
        if first {
            self.touches.rate.fill(0.0);
        }
        if !self.accelerate_ahead(own, qd, first)? && halvings > 0 {
            q.copy_from_slice(&self.touches.before);
            let halved = Substep { h: half, ..*own };
            self.substep(&halved, first, halvings - 1, q, qd)?;
            return self.substep(&halved, false, halvings - 1, q, qd);
        }
        qd.iter_mut().zip(&self.touches.rate).for_each(|(v, a)| *v += h * a);
        self.touches.tell(scene, h / system.frame_time, &mut self.forces);
        drift(robot, q, qd, half);
        Ok(())
    }

    /// Dampings of the joints, and shares of their dampers and springs.
    fn damp(&mut self, robot: &Robot, h: f64) -> Result<(), String> {
        self.touches.shared = h;
        let mut factored = false;
        for (i, joint) in robot.joints().enumerate() {
            (self.touches.braked[i], self.touches.dampers[i], self.touches.springs[i]) = (joint.damping, 0.5, 0.0);
            if h * joint.damping.max(h * joint.stiffness) <= self.stiff.bounds.least[i] {
                continue;
            }
            self.plain(robot, &mut factored)?;
            let Touches { right, tree, .. } = &mut self.touches;
            let w = match tree {
                Some(tree) => tree.ease(robot, i),
                None => {
                    let k = robot.root_dofs() + i;
                    right.fill(0.0);
                    right[k] = 1.0;
                    self.factor.solve(right);
                    right[k]
                }
            };
            let z = h * h * joint.stiffness * w;
            self.touches.braked[i] = joint.damping.max(h * joint.stiffness * z.min(CALM));
            self.touches.dampers[i] = exponential(h * self.touches.braked[i] * w);
            self.touches.springs[i] = ahead(z);
        }
        Ok(())
    }

    /// The inverse of the mass matrix alone, if it is not there yet.
    fn plain(&mut self, robot: &Robot, there: &mut bool) -> Result<(), String> {
        if std::mem::replace(there, true) {
            return Ok(());
        }
        let (sound, lost) = match &mut self.touches.tree {
            Some(tree) => (tree.plain(robot, &self.data), Some(tree.lost())),
            None => (self.factor.refill(&self.data.mass), None),
        };
        if sound { Ok(()) } else { Err(self.factor.fault_at(robot, lost)) }
    }

    /// How far ahead each force must look to be stable, from the touch's own inertia `1 / w = 1 / n^T J M^-1 J^T n`.
    fn weigh(&mut self, robot: &Robot, h: f64, friction: Friction) -> Result<(), String> {
        let mut factored = false;
        if self.touches.touches.iter().any(|t| self.touches.weights[t.index].is_none()) {
            self.plain(robot, &mut factored)?;
        }
        let Touches { touches, columns, weights, right, tree, .. } = &mut self.touches;
        for touch in touches.iter_mut() {
            let columns = &columns[touch.columns.clone()];
            if weights[touch.index].is_none() {
                let w: f64 = match tree {
                    Some(tree) => tree.eased(robot, touch, columns),
                    None => {
                        right.fill(0.0);
                        // Joints that follow one share its column.
                        columns.iter().for_each(|(k, a)| right[*k] += touch.normal.dot(a));
                        self.factor.solve(right);
                        columns.iter().map(|(k, a)| right[*k] * touch.normal.dot(a)).sum()
                    }
                };
                // What only rubs, as dry friction does, always looks all the way ahead.
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
            touch.ahead = [ahead(h * h * m.stiffness * w), damper(m.damping), damper(touch.across)];
        }
        Ok(())
    }

    /// `rate`, the change of local velocities over h, from forces in the substep's middle; `false` if the substep is too long to find it.
    fn accelerate_ahead(&mut self, own: &Substep, qd: &[f64], first: bool) -> Result<bool, String> {
        let Substep { system, scene, config, tau, h, settled, .. } = *own;
        let robot = &system.robot;
        let dofs = robot.root_dofs();
        let Touches { braked, dampers, springs, mass, tree, .. } = &mut self.touches;
        let shares = robot.joints().zip(braked).zip(dampers).zip(springs);
        let shares = shares.map(|(((joint, d), damper), spring)| *damper * h * *d + *spring * h * h * joint.stiffness);
        if let Some(tree) = tree {
            tree.damp(shares);
        } else {
            shares.enumerate().for_each(|(i, share)| self.data.mass[(dofs + i, dofs + i)] += share);
            mass.copy_from(&self.data.mass);
        }
        let (mut stale, mut correct, mut corrected, mut quiet, mut found) = (true, first, false, false, true);
        for _ in 0..PASSES {
            let Touches { middle, rate, right, pull, braked, .. } = &mut self.touches;
            if stale {
                middle.iter_mut().zip(qd.iter().zip(rate.iter())).for_each(|(m, (v, a))| *m = v + 0.5 * h * a);
                bias(robot, middle, &scene.gravity, &mut self.data);
                right.iter_mut().zip(self.data.tau.iter()).for_each(|(r, t)| *r = -t);
                for (i, right) in right[dofs..].iter_mut().enumerate() {
                    *right += tau[i] + pull[i] - braked[i] * qd[dofs + i];
                }
            }
            let changed = self.solve(robot, h, settled, config.friction)?;
            // The rate that an unbounded drive would give says nothing of the middle.
            let wait = changed && !self.drives.is_empty();
            let Touches { middle, rate, tree, .. } = &mut self.touches;
            if tree.is_some() {
                // A chain may whip: then the rate of the substep before says little of this one's middle.
                let joints = middle.iter().zip(qd.iter().zip(self.data.qdd.iter())).skip(dofs);
                let jump = joints.fold(0.0f64, |most, (m, (v, a))| most.max((v + 0.5 * h * a - m).abs())) * h;
                found = jump <= LOST;
                // What changed because a point has parted is no whip.
                if !jump.is_finite() || corrected && quiet && !found {
                    return Ok(false);
                }
                correct |= jump > if corrected { LOST } else { OFF };
                quiet = !changed;
            }
            rate.copy_from_slice(self.data.qdd.as_slice());
            if robot.floating() {
                // The derivative of a velocity that moves along is the spatial acceleration and w x v.
                let turn = vector(&middle[..3]).cross(&vector(&middle[3..6]));
                (0..3).for_each(|k| rate[3 + k] += turn[k]);
            }
            if !changed && !correct {
                return Ok(true);
            }
            stale = correct && !wait;
            correct &= wait;
            corrected |= stale;
        }
        Ok(found)
    }

    /// Accelerations with the touches that have not parted. Then each one's drag is that of its force and slip at the
    /// end, and a point that would pull has parted; whether that changes anything.
    fn solve(&mut self, robot: &Robot, h: f64, settled: f64, friction: Friction) -> Result<bool, String> {
        let Touches { touches, columns, mass, right, tree, .. } = &mut self.touches;
        match tree {
            Some(tree) => tree.clear(),
            None => self.data.mass.copy_from(mass),
        }
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
            if let (Some(tree), Some(link)) = (&mut *tree, touch.link) {
                tree.point(link, touch, force, (along, across), h);
                continue;
            }
            for (i, a) in &columns[touch.columns.clone()] {
                self.data.qdd[*i] += a.dot(&force);
                // h D a
                let d = (n * ((along - across) * n.dot(a)) + a * across) * h;
                if let Some(tree) = &mut *tree {
                    tree.joint(i - robot.root_dofs(), a.dot(&d));
                    continue;
                }
                for (j, b) in &columns[touch.columns.clone()] {
                    self.data.mass[(*i, *j)] += b.dot(&d);
                }
            }
        }
        let mut qdd = std::mem::replace(&mut self.data.qdd, DVector::zeros(0));
        let (sound, lost) = match tree {
            Some(tree) => (tree.solve(robot, &self.data, qdd.as_mut_slice()), Some(tree.lost())),
            None => (self.factor.refill(&self.data.mass), None),
        };
        self.data.qdd = qdd;
        if !sound {
            return Err(self.factor.fault_at(robot, lost));
        }
        if tree.is_none() {
            self.factor.solve(self.data.qdd.as_mut_slice());
        }
        let mut changed = false;
        for touch in touches.iter_mut().filter(|t| !t.parted && t.held.is_none() && (!t.sticky || t.bounds.is_some())) {
            let (n, m, [spring, damper, slide]) = (&touch.normal, &touch.material, touch.ahead);
            let change: Vector3<f64> = match (&*tree, touch.link) {
                (Some(tree), Some(link)) => tree.at(link, &touch.x) * h,
                _ => columns[touch.columns.clone()].iter().map(|(k, a)| a * (h * self.data.qdd[*k])).sum(),
            };
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

/// The share of a spring with `z = h^2 k w` that keeps it stable.
fn ahead(z: f64) -> f64 {
    (0.5 - 0.5 / z).max(0.0)
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
