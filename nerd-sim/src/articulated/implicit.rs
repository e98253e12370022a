//! Accelerations over a substep h with contact, limits and joint damping at its end, linearised about its start.
//!
//! With the normal force `N = -(k (g + h v_n') + d v_n')` and friction `-c v_t'` of the velocity v' at the substep's end
//! (c the drag of the law, found by repetition), `D = (k h + d) n n^T + c (1 - n n^T)` and J the Jacobian of the point,
//!
//! ```text
//! (M + h sum J^T D J) qdd = tau - bias + sum J^T f,    f = -(k (g + h v_n) + d v_n) n - c v_t
//! ```
//!
//! A point couples only the joints above it, so the matrix keeps the tree's zeros and the factorisation its cost. A point
//! that would pull at the end has parted; it is dropped and the system solved again.

use nalgebra::{DMatrix, Vector3};
use nerd_core::dynamics::{bias, crba, kinematics, velocities};
use nerd_core::robot::{Limit, Robot};
use nerd_core::spatial::Wrench;

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
    /// `k g` (N) and `k h + d`, `c` (N s/m).
    spring: f64,
    along: f64,
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
}

impl Touches {
    pub(super) fn new(robot: &Robot) -> Self {
        let (points, nv) = (robot.contact_points.len(), robot.nv());
        Self {
            touches: Vec::with_capacity(points),
            columns: Vec::with_capacity(points * nv),
            mass: DMatrix::zeros(nv, nv),
            right: vec![0.0; nv],
        }
    }
}

/// Solves of a substep at most.
const PASSES: usize = 4;
/// Change of a drag, relative, that asks for no other solve.
const SETTLED: f64 = 0.02;

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
        self.find(robot, config, h);
        let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
        // Where a joint will be decides whether it is in its limit.
        let beyond = |limit: &Limit, i: usize| {
            let ahead = q[coords + i] + h * qd[dofs + i];
            limit.stiffness > 0.0 && !(limit.lower..=limit.upper).contains(&ahead)
        };
        let limited = robot.joints().enumerate().any(|(i, joint)| joint.limit.as_ref().is_some_and(|l| beyond(l, i)));
        if self.touches.touches.is_empty() && !limited {
            return Ok(false);
        }
        crba(robot, &mut self.data);
        self.data.external.fill(Wrench::default());
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
        for _ in 0..PASSES {
            if !self.solve(qd, h, config.friction)? {
                break;
            }
        }
        advance(robot, q, qd, self.data.qdd.as_slice(), h);
        Ok(true)
    }

    /// The points that touch by the end of the substep, if they go on as they do.
    fn find(&mut self, robot: &Robot, config: &ArticulatedConfig, h: f64) {
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
            if gap + h * vn >= 0.0 {
                continue;
            }
            let material = &self.materials[event.collider];
            let damping = if vn < 0.0 { material.damping } else { 0.0 };
            let along = material.stiffness * h + damping;
            let normal = (-(material.stiffness * gap + along * vn)).max(0.0);
            let across = drag(normal, (velocity - n * vn).norm(), material, config.friction);
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
            let material = *material;
            touches.push(Touch { columns, material, normal: n, spring: material.stiffness * gap, along, across, velocity, active: true });
        }
    }

    /// Accelerations with the active points. Then each point's drag is that of its force and slip at the end, and one that
    /// would pull is active no more; whether that changes anything.
    fn solve(&mut self, qd: &[f64], h: f64, friction: Friction) -> Result<bool, String> {
        let Touches { touches, columns, mass, right } = &mut self.touches;
        self.data.mass.copy_from(mass);
        self.data.qdd.as_mut_slice().copy_from_slice(right);
        for touch in touches.iter().filter(|t| t.active) {
            let n = &touch.normal;
            let vn = n.dot(&touch.velocity);
            let force = n * -(touch.spring + touch.along * vn) - (touch.velocity - n * vn) * touch.across;
            for (i, a) in &columns[touch.columns.clone()] {
                self.data.qdd[*i] += a.dot(&force);
                // h D a
                let d = (n * ((touch.along - touch.across) * n.dot(a)) + a * touch.across) * h;
                for (j, b) in &columns[touch.columns.clone()] {
                    self.data.mass[(*i, *j)] += b.dot(&d);
                }
            }
        }
        if !self.factor.refill(&self.data.mass) {
            return Err("the mass matrix is not positive definite: a link without inertia, or a state out of bounds".into());
        }
        self.factor.solve(self.data.qdd.as_mut_slice());
        let mut changed = false;
        for touch in touches.iter_mut().filter(|t| t.active) {
            let end: Vector3<f64> = columns[touch.columns.clone()].iter().map(|(k, a)| a * (qd[*k] + h * self.data.qdd[*k])).sum();
            let vn = touch.normal.dot(&end);
            let normal = -(touch.spring + touch.along * vn);
            touch.active = normal >= 0.0;
            let across = drag(normal, (end - touch.normal * vn).norm(), &touch.material, friction);
            changed |= !touch.active || (across / touch.across - 1.0).abs() > SETTLED;
            touch.across = across;
        }
        Ok(changed)
    }
}
