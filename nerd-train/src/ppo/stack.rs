//! Stacked observations, for tasks with partial observations: the newest observation of each environment, then
//! differences of successive observations.
//!
//! Differences carry the information of older observations. The policy normalises each column by that column's moments,
//! which makes small differences visible. Two joint angles 8 ms apart hardly show the velocity; their difference shows
//! only the velocity.

use rayon::prelude::*;

/// Least number of environments per thread.
const FEW: usize = 256;

/// Stacked observations of all environments.
#[derive(Clone, Debug, PartialEq)]
pub struct Stack {
    depth: usize,
    width: usize,
    /// Rows `[env][depth][observation]`: the newest observation, then differences of successive observations, newest
    /// first.
    pub rows: Vec<f64>,
}

impl Stack {
    /// Begins an episode in every environment with the observations `first`; all differences are 0.
    pub fn new(depth: usize, width: usize, first: &[f64]) -> Self {
        let mut stack = Self { depth, width, rows: vec![0.0; first.len() * depth] };
        stack.begin(|_| true, first);
        stack
    }

    /// Pushes the observations `reached` by a step, `[env][observation]`. Copies the rows of the environments `some` to
    /// `out`, then restarts the rows of `ended` episodes with the observations `fresh`.
    pub fn push(
        &mut self,
        reached: &[f64],
        some: &[usize],
        ended: impl Fn(usize) -> bool + Sync,
        fresh: &[f64],
        out: &mut Vec<f64>,
    ) {
        let width = self.width;
        let all = self.width * self.depth;
        let seen = reached.par_chunks_exact(width);
        self.rows.par_chunks_exact_mut(all).zip(seen).with_min_len(FEW).for_each(|(row, now)| {
            if width < all {
                row.copy_within(width..all - width, 2 * width);
                let (newest, difference) = row[..2 * width].split_at_mut(width);
                difference.iter_mut().zip(now).zip(newest).for_each(|((d, now), before)| *d = now - *before);
            }
            row[..width].copy_from_slice(now);
        });
        out.clear();
        some.iter().for_each(|env| out.extend_from_slice(&self.rows[env * all..][..all]));
        self.begin(ended, fresh);
    }

    pub(super) fn begin(&mut self, which: impl Fn(usize) -> bool + Sync, fresh: &[f64]) {
        let width = self.width;
        let all = self.width * self.depth;
        let rows = self.rows.par_chunks_exact_mut(all).zip(fresh.par_chunks_exact(width)).with_min_len(FEW).enumerate();
        rows.filter(|(env, _)| which(*env)).for_each(|(_, (row, now))| {
            row.fill(0.0);
            row[..width].copy_from_slice(now);
        });
    }
}
