//! One frame of a chain: applies the network's outputs to rods.
//!
//! A rod has the direction t, its rate td (1/s) and the outputs `a` and `r`. With the frame time T (s), `u = td + a`,
//! `t' = t + T (td + u) / 2 + r` scaled to unit length, `td' = u - t' (t' . u)`. The gripper's outputs add to its
//! motion under its drives ([`Chain::glide`]).

use super::{Chain, Gripper, Rods};
use crate::prelude::*;

/// Number of outputs of a rod: change of rate (3), correction of the direction (3), and, for the first rod alone,
/// correction of the gripper (12).
pub const OUTPUTS: usize = 18;

/// A network's outputs for a chain's rods, `[rod][OUTPUTS]`, and their scales.
#[derive(Clone, Copy)]
pub struct Outputs<'a> {
    /// Normalised outputs.
    pub numbers: &'a [f32],
    /// Scale of each output, `[OUTPUTS]`.
    pub scale: &'a [f64; OUTPUTS],
}

impl Outputs<'_> {
    fn vector(&self, rod: usize, first: usize) -> Vector3<f64> {
        let row = &self.numbers[rod * OUTPUTS + first..][..3];
        let scale = &self.scale[first..];
        Vector3::new(f64::from(row[0]) * scale[0], f64::from(row[1]) * scale[1], f64::from(row[2]) * scale[2])
    }
}

impl Chain {
    /// The chain after a frame, from the chain before, the gripper moved by its drives and the outputs.
    pub fn advance(&self, before: &Rods, glided: &Gripper, outputs: Outputs) -> Rods {
        let mut after = Rods { gripper: *glided, ..before.clone() };
        for k in 0..self.rods {
            let (u, raw) = self.raw(before, k, outputs);
            let t = raw.normalize();
            (after.along[k], after.rates[k]) = (t, u - t * t.dot(&u));
        }
        let own = outputs.numbers[6..OUTPUTS].iter().zip(&outputs.scale[6..]);
        after.gripper.numbers_mut().zip(own).for_each(|(x, (output, scale))| *x += f64::from(*output) * scale);
        after
    }

    /// New rate u and new direction of a rod, before the direction is normalised and u is made orthogonal to it.
    fn raw(&self, before: &Rods, k: usize, outputs: Outputs) -> (Vector3<f64>, Vector3<f64>) {
        let u = before.rates[k] + outputs.vector(k, 0);
        (u, before.along[k] + (before.rates[k] + u) * (0.5 * self.frame_time) + outputs.vector(k, 3))
    }

    /// Adjoint of [`Chain::advance`]: adds the gradient with respect to `before` to `gradient`. Returns the gradient
    /// with respect to the outputs, `[rod][OUTPUTS]`. The gradient with respect to `glided` is `upstream.gripper`; the
    /// caller adds it.
    pub fn advance_back(&self, before: &Rods, outputs: Outputs, upstream: &Rods, gradient: &mut Rods) -> Vec<f32> {
        let mut by_outputs = vec![0.0; self.rods * OUTPUTS];
        for (k, row) in by_outputs.as_chunks_mut::<OUTPUTS>().0.iter_mut().enumerate() {
            let (u, raw) = self.raw(before, k, outputs);
            let size = raw.norm();
            let t = raw.normalize();
            let g = upstream.rates[k];
            let along = t.dot(&u);
            let by_t = upstream.along[k] - g * along - u * t.dot(&g);
            let by_raw = (by_t - t * t.dot(&by_t)) / size;
            let by_u = g - t * t.dot(&g) + by_raw * (0.5 * self.frame_time);
            gradient.along[k] += by_raw;
            gradient.rates[k] += by_u + by_raw * (0.5 * self.frame_time);
            let own = by_u.iter().chain(by_raw.iter()).zip(outputs.scale);
            row.iter_mut().zip(own).for_each(|(row, (x, scale))| *row = (x * scale) as f32);
        }
        let own = upstream.gripper.numbers().zip(&outputs.scale[6..]);
        by_outputs[6..OUTPUTS].iter_mut().zip(own).for_each(|(row, (x, scale))| *row = (x * scale) as f32);
        by_outputs
    }
}
