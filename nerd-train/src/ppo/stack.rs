//! The last observations of every environment, the newest first: memory for tasks whose state one observation does not show.

/// Stacked observations.
#[derive(Clone, Debug, PartialEq)]
pub struct Stack {
    depth: usize,
    width: usize,
    /// Rows `[env][depth][observation]`.
    pub rows: Vec<f64>,
}

impl Stack {
    /// An episode begins in every environment with these observations; what was before counts as the same.
    pub fn new(depth: usize, width: usize, first: &[f64]) -> Self {
        let rows = first.chunks_exact(width).flat_map(|row| row.repeat(depth)).collect();
        Self { depth, width, rows }
    }

    /// Takes in a step: the rows as they were `reached` go to `out`, then those of episodes that `ended` begin anew with `fresh`.
    pub fn push(&mut self, reached: &[f64], ended: impl Fn(usize) -> bool, fresh: &[f64], out: &mut Vec<f64>) {
        let (width, all) = (self.width, self.width * self.depth);
        let seen = reached.chunks_exact(width);
        for (row, now) in self.rows.chunks_exact_mut(all).zip(seen) {
            row.copy_within(..all - width, width);
            row[..width].copy_from_slice(now);
        }
        out.clone_from(&self.rows);
        for (env, (row, now)) in self.rows.chunks_exact_mut(all).zip(fresh.chunks_exact(width)).enumerate() {
            if ended(env) {
                row.chunks_exact_mut(width).for_each(|old| old.copy_from_slice(now));
            }
        }
    }
}
