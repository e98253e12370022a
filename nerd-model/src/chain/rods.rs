//! Exact conversion between joint coordinates and rods.
//!
//! R are the axes of the previous rod and w their angular velocity. A rod's hinges rotate by a about z and by b about
//! the new y: `t = R Rz(a) Ry(b) x = R (cos a cos b, sin a cos b, -sin b)`, and `dt/dt = w' x t` with the rod's angular
//! velocity w'. So a and b are `atan2` of the components of t in R. With `r = dt/dt - w x t` and y, x', z the axes
//! between the hinges, `a' = r . y / cos b`, `b' = -r . (z cos b + x' sin b)`. The bend from rod to rod must be below a
//! right angle.

use super::{Chain, Gripper};
use crate::prelude::*;

/// State of a chain as rods. In an adjoint pass, the fields hold gradients with respect to these numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rods {
    /// State of the gripper.
    pub gripper: Gripper,
    /// Direction of each rod, the gripper's end first (world, unit length).
    pub along: Vec<Vector3<f64>>,
    /// Rates of the directions (1/s).
    pub rates: Vec<Vector3<f64>>,
}

impl Rods {
    /// All numbers zero, for `rods` rods: the start of a sum of gradients.
    pub fn zeros(rods: usize) -> Self {
        Self { gripper: Gripper::default(), along: vec![Vector3::zeros(); rods], rates: vec![Vector3::zeros(); rods] }
    }

    /// Whether all numbers are finite.
    pub fn finite(&self) -> bool {
        let finite = |v: &Vector3<f64>| v.sum().is_finite();
        self.gripper.numbers().all(f64::is_finite) && self.along.iter().chain(&self.rates).all(finite)
    }
}

/// Axes of a link, and their angular velocity (rad/s), in world axes.
struct Axes {
    r: Matrix3<f64>,
    w: Vector3<f64>,
}

impl Axes {
    fn column(&self, k: usize) -> Vector3<f64> {
        self.r.column(k).into()
    }

    /// Rotates the axes by `angle` (rad) about body axis k, and adds `rate` (rad/s) about it to their angular velocity.
    fn turn(&mut self, k: usize, angle: f64, rate: f64) {
        self.w += self.column(k) * rate;
        let (s, c) = angle.sin_cos();
        let i = (k + 1) % 3;
        let j = (k + 2) % 3;
        let (x, y) = (self.column(i), self.column(j));
        self.r.set_column(i, &(x * c + y * s));
        self.r.set_column(j, &(y * c - x * s));
    }

    fn of(gripper: &Gripper) -> Self {
        let mut axes = Self { r: Matrix3::identity(), w: Vector3::zeros() };
        [2, 1, 0].into_iter().enumerate().for_each(|(i, k)| axes.turn(k, gripper.angles[i], gripper.rates[i]));
        axes
    }
}

impl Chain {
    /// Number of coordinates, the length of `q` and of `qd`.
    fn coordinates(&self) -> usize {
        6 + 2 * self.rods
    }

    /// Converts a state `[q, qd]` (m, rad; m/s, rad/s) to rods.
    pub fn rods(&self, state: &[f64]) -> Rods {
        let (q, qd) = state.split_at(self.coordinates());
        let vector = |x: &[f64], first: usize| Vector3::new(x[first], x[first + 1], x[first + 2]);
        let gripper = Gripper {
            at: self.home + vector(q, 0),
            velocity: vector(qd, 0),
            angles: vector(q, 3),
            rates: vector(qd, 3),
        };
        let mut axes = Axes::of(&gripper);
        let mut along = Vec::with_capacity(self.rods);
        let mut rates = Vec::with_capacity(self.rods);
        for k in (6..q.len()).step_by(2) {
            axes.turn(2, q[k], qd[k]);
            axes.turn(1, q[k + 1], qd[k + 1]);
            let t = axes.column(0);
            along.push(t);
            rates.push(axes.w.cross(&t));
        }
        Rods { gripper, along, rates }
    }

    /// Converts rods to a state `[q, qd]` and writes it to `state`.
    pub fn state(&self, rods: &Rods, state: &mut [f64]) {
        let (q, qd) = state.split_at_mut(self.coordinates());
        let Gripper { at, velocity, angles, rates } = &rods.gripper;
        q[..3].copy_from_slice((at - self.home).as_slice());
        q[3..6].copy_from_slice(angles.as_slice());
        qd[..3].copy_from_slice(velocity.as_slice());
        qd[3..6].copy_from_slice(rates.as_slice());
        let mut axes = Axes::of(&rods.gripper);
        for (k, (t, rate)) in rods.along.iter().zip(&rods.rates).enumerate() {
            let own = axes.r.tr_mul(t);
            let k = 6 + 2 * k;
            let level = own.x.hypot(own.y);
            (q[k], q[k + 1]) = (own.y.atan2(own.x), (-own.z).atan2(level));
            let r = rate - axes.w.cross(t);
            let size = level.hypot(own.z);
            let (cos, sin) = (level / size, -own.z / size);
            axes.turn(2, q[k], 0.0);
            qd[k] = r.dot(&axes.column(1)) / cos;
            qd[k + 1] = -r.dot(&(axes.column(2) * cos + axes.column(0) * sin));
            axes.w += axes.column(2) * qd[k];
            axes.turn(1, q[k + 1], qd[k + 1]);
        }
    }

    /// Position of each rod's end, `x_i = gripper + l sum t` (m, world), and the end's velocity (m/s).
    pub fn nodes(&self, rods: &Rods) -> [Vec<Vector3<f64>>; 2] {
        let sum = |from: Vector3<f64>, steps: &[Vector3<f64>]| {
            let mut at = from;
            let next = |step: &Vector3<f64>| {
                at += step * self.length;
                at
            };
            steps.iter().map(next).collect()
        };
        [sum(rods.gripper.at, &rods.along), sum(rods.gripper.velocity, &rods.rates)]
    }

    /// Adjoint of [`Chain::nodes`]: adds the gradient with respect to the rods to `gradient`. A rod's direction moves
    /// its own end and all ends after it.
    pub fn nodes_back(&self, upstream: &[Vec<Vector3<f64>>; 2], gradient: &mut Rods) {
        let Rods { gripper, along, rates } = gradient;
        let parts = [(&upstream[0], &mut gripper.at, along), (&upstream[1], &mut gripper.velocity, rates)];
        for (upstream, first, steps) in parts {
            let mut total = Vector3::zeros();
            for (upstream, step) in upstream.iter().zip(steps).rev() {
                total += upstream;
                *step += total * self.length;
            }
            *first += total;
        }
    }
}
