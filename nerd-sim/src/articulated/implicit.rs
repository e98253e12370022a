//! A substep h with contact, limits, joint damping and dry friction looking ahead, linearised, so that it is stable at any length.
//!
//! Spring, damper and friction of a point see the velocity `v + a (v' - v)` between the substep's start and its end, each
//! with its own share a: none for a spring and half for a damper while that is stable, more as they grow stiff for the
//! point's own inertia, `1 / w = 1 / n^T J M^-1 J^T n`, and the substep:
//!
//! ```text
//! spring a = max(0, 1/2 - 1 / (2 h^2 k w))      (no damping of its own below h^2 k w = 1, as symplectic Euler)
//! damper a = max(1/2, 1 - 1 / (h d w))          (friction's drag likewise)
//! (M + h sum J^T D J) qdd = tau - bias + sum J^T f,    D = (a_k h k + a_d d) n n^T + a_c c (1 - n n^T)
//! f = -(k (g + a_k h v_n) + d min(v_n, 0)) n - c v_t
//! ```
//!
//! The drag c is the law's at the velocity seen, found by repetition. A point couples only the joints above it, so the
//! matrix keeps the tree's zeros and the factorisation its cost. A point that would pull has parted; it is dropped and the
//! system solved again. So is a system in which a joint's dry friction f, `f v' / 1 mm/s` while it holds and f against the
//! motion while it slips, turns out to do the other. In a substep in which nothing touches the midpoint rule serves.

use nalgebra::{DMatrix, Vector3};
use nerd_core::dynamics::{bias, crba, kinematics, velocities};
use nerd_core::robot::{Joint, Limit, Robot};

use super::frame::{Workspace, advance};
use super::law::drag;
use super::{ArticulatedConfig, Friction};
use crate::scene::{Material, Scene};
use crate::system::System;

/// One point that touches, or will within the substep.
struct Touch {
    /// Its columns among all: `J = [.. column ..]` by DoF.
    columns: std::ops::Range<usize>,
    material: Material,
    normal: Vector3<f64>,
    gap: f64,
    /// Shares a of the spring, the damper and the drag.
    ahead: [f64; 3],
    /// Drag c (N s/m).
    across: f64,
    velocity: Vector3<f64>,
    active: bool,
}

/// Working memory.
pub(super) struct Touches {
    touches: Vec<Touch>,
    columns: Vec<(usize, Vector3<f64>)>,
    mass: DMatrix<f64>,
    right: Vec<f64>,
    /// Way each joint with dry friction slips, see [`slip`].
    slips: Vec<f64>,
}

impl Touches {
    pub(super) fn new(robot: &Robot) -> Self {
        let (points, nv) = (robot.contact_points.len(), robot.nv());
        Self {
            touches: Vec::with_capacity(points),
            columns: Vec::with_capacity(points * nv),
            mass: DMatrix::zeros(nv, nv),
            right: vec![0.0; nv],
            slips: Vec::with_capacity(nv),
        }
    }
}

/// Solves of a substep at most; four times as many with dry friction.
const PASSES: usize = 4;
/// Velocity (rad/s or m/s) below which dry friction holds, as a drag: what it holds creeps.
const CREEP: f64 = 1e-3;
/// Change of a drag, relative, that asks for no other solve.
const SETTLED: f64 = 0.02;

/// Way a joint slips, -1 or 1; 0 where dry friction holds it.
fn slip(v: f64) -> f64 {
    if v.abs() > CREEP { v.signum() } else { 0.0 }
}

impl Workspace {
    /// One substep `h` (s), in local velocities, with whatever touches or stands in a limit at its end. `false`, and nothing
    /// done, if there is no such thing.
    pub(super) fn implicit(
        &mut self,
        system: &System,
        scene: &Scene,
        config: &ArticulatedConfig,
        state: &mut [f64],
        tau: &[f64],
        h: f64,
    ) -> Result<bool, String> {
        let robot = &system.robot;
        let (q, qd) = state.split_at_mut(robot.nq());
        kinematics(robot, q, &mut self.data);
        velocities(robot, qd, &mut self.data);
        self.query(system, scene);
        self.find(robot, h);
        let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
        // Where a joint will be decides whether it is in its limit.
        let beyond = |limit: &Limit, i: usize| {
            let ahead = q[coords + i] + h * qd[dofs + i];
            limit.stiffness > 0.0 && !(limit.lower..=limit.upper).contains(&ahead)
        };
        let limited = robot.joints().enumerate().any(|(i, joint)| joint.limit.as_ref().is_some_and(|l| beyond(l, i)));
        if self.touches.touches.is_empty() && !limited && !robot.dry() {
            return Ok(false);
        }
        crba(robot, &mut self.data);
        self.weigh(robot, h, config.friction)?;
        bias(robot, qd, &scene.gravity, &mut self.data);
        for (i, joint) in robot.joints().enumerate() {
            let (x, v, k) = (q[coords + i], qd[dofs + i], dofs + i);
            let (mut stiff, mut force) = (joint.damping, tau[i] - joint.damping * v);
            if let Some(limit) = joint.limit.as_ref().filter(|l| beyond(l, i)) {
                force += limit.force(x + h * v, v);
                stiff += limit.damping + h * limit.stiffness;
            }
            self.data.mass[(k, k)] += h * stiff;
            self.data.tau[k] -= force;
        }
        self.touches.mass.copy_from(&self.data.mass);
        self.touches.right.iter_mut().zip(self.data.tau.iter()).for_each(|(r, t)| *r = -t);
        let slips = |(joint, v): (&Joint, &f64)| if joint.friction > 0.0 { slip(*v) } else { 0.0 };
        self.touches.slips.clear();
        self.touches.slips.extend(robot.joints().zip(&qd[dofs..]).map(slips));
        for _ in 0..if robot.dry() { 4 * PASSES } else { PASSES } {
            if !self.solve(robot, qd, h, config.friction)? {
                break;
            }
        }
        advance(robot, q, qd, self.data.qdd.as_slice(), h);
        Ok(true)
    }

    /// The points that touch by the end of the substep, if they go on as they do.
    fn find(&mut self, robot: &Robot, h: f64) {
        let Touches { touches, columns, .. } = &mut self.touches;
        touches.clear();
        columns.clear();
        let (data, first, dofs) = (&self.data, usize::from(robot.floating()), robot.root_dofs());
        for (point, event) in robot.contact_points.iter().zip(&self.events) {
            if !event.distance.is_finite() {
                continue;
            }
            let n = event.normal;
            let x = data.position[point.link] + data.rotation[point.link] * point.local - n * point.radius;
            let gap = n.dot(&(x - (event.p1 - data.origin)));
            let velocity = data.velocity[point.link].at(&x);
            let vn = n.dot(&velocity);
            if gap.min(gap + h * vn) >= 0.0 {
                continue;
            }
            let start = columns.len();
            let mut link = Some(point.link);
            while let Some(i) = link {
                if robot.links[i].joint.is_some() {
                    columns.push((dofs + i - first, data.axis[i].at(&x)));
                } else {
                    for k in 0..3 {
                        columns.push((k, Vector3::ith(k, 1.0).cross(&x)));
                        columns.push((3 + k, Vector3::ith(k, 1.0)));
                    }
                }
                link = robot.links[i].parent;
            }
            let columns = start..columns.len();
            let material = self.materials[event.collider];
            touches.push(Touch { columns, material, normal: n, gap, ahead: [0.0; 3], across: 0.0, velocity, active: true });
        }
    }

    /// How far ahead each force must look to be stable, from the point's own inertia `1 / w = 1 / n^T J M^-1 J^T n`.
    fn weigh(&mut self, robot: &Robot, h: f64, friction: Friction) -> Result<(), String> {
        if !self.factor.refill(&self.data.mass) {
            return Err(self.factor.fault(robot));
        }
        let Touches { touches, columns, right, .. } = &mut self.touches;
        for touch in touches.iter_mut() {
            let columns = &columns[touch.columns.clone()];
            right.fill(0.0);
            columns.iter().for_each(|(k, a)| right[*k] = touch.normal.dot(a));
            self.factor.solve(right);
            let w: f64 = columns.iter().map(|(k, a)| right[*k] * touch.normal.dot(a)).sum();
            let vn = touch.normal.dot(&touch.velocity);
            if vn >= 0.0 {
                touch.material.damping = 0.0;
            }
            let m = &touch.material;
            let spring = (0.5 - 0.5 / (h * h * m.stiffness * w)).max(0.0);
            let damper = |d: f64| (1.0 - 1.0 / (h * d * w)).max(0.5);
            let damping = damper(m.damping);
            touch.active = touch.gap + spring * h * vn < 0.0;
            let normal = (-(m.stiffness * (touch.gap + spring * h * vn) + m.damping * vn)).max(0.0);
            touch.across = drag(normal, (touch.velocity - touch.normal * vn).norm(), m, friction);
            touch.ahead = [spring, damping, damper(touch.across)];
        }
        Ok(())
    }

    /// Accelerations with the active points. Then each point's drag is that of its force and slip at the end, and one that
    /// would pull is active no more; whether that changes anything.
    fn solve(&mut self, robot: &Robot, qd: &[f64], h: f64, friction: Friction) -> Result<bool, String> {
        let Touches { touches, columns, mass, right, slips } = &mut self.touches;
        self.data.mass.copy_from(mass);
        self.data.qdd.as_mut_slice().copy_from_slice(right);
        let dry = || robot.joints().map(|j| j.friction).enumerate().filter(|(_, f)| *f > 0.0);
        for (i, f) in dry() {
            let (k, drag) = (robot.root_dofs() + i, if slips[i] == 0.0 { f / CREEP } else { 0.0 });
            self.data.mass[(k, k)] += h * drag;
            self.data.qdd[k] -= drag * qd[k] + slips[i] * f;
        }
        for touch in touches.iter().filter(|t| t.active) {
            let (n, m, [spring, damper, slide]) = (&touch.normal, &touch.material, touch.ahead);
            let vn = n.dot(&touch.velocity);
            let normal = m.stiffness * (touch.gap + spring * h * vn) + m.damping * vn;
            let force = n * -normal - (touch.velocity - n * vn) * touch.across;
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
        for (i, _) in dry() {
            let k = robot.root_dofs() + i;
            let now = slip(qd[k] + h * self.data.qdd[k]);
            // One that would turn round is held first.
            let now = if slips[i] * now < 0.0 { 0.0 } else { now };
            changed |= now != slips[i];
            slips[i] = now;
        }
        for touch in touches.iter_mut().filter(|t| t.active) {
            let (n, m, [spring, damper, slide]) = (&touch.normal, &touch.material, touch.ahead);
            let change: Vector3<f64> = columns[touch.columns.clone()].iter().map(|(k, a)| a * (h * self.data.qdd[*k])).sum();
            let (vn, dn) = (n.dot(&touch.velocity), n.dot(&change));
            let normal = -(m.stiffness * (touch.gap + spring * h * (vn + dn)) + m.damping * (vn + damper * dn));
            touch.active = normal >= 0.0;
            let seen = touch.velocity + change * slide;
            let across = drag(normal.max(0.0), (seen - n * n.dot(&seen)).norm(), m, friction);
            changed |= !touch.active || (across / touch.across - 1.0).abs() > SETTLED;
            touch.across = across;
        }
        Ok(changed)
    }
}
