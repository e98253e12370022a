//! Running mean and variance, by the batch update of Chan, Golub and LeVeque.
//!
//! Let n be the number of rows so far, and let m new rows have mean b and variance w. With `d = b - mean`:
//! `mean += d m / (n + m)`, `variance = (n variance + m w + d^2 n m / (n + m)) / (n + m)`.

use super::*;

/// Running moments of the columns of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunningMoments {
    /// Mean by column.
    pub mean: Vec<f64>,
    /// Variance by column.
    pub variance: Vec<f64>,
    /// Rows so far, starting at 1: the initial mean 0 and variance 1 count as one row.
    pub count: f64,
}

/// Bound (absolute value) that normalised numbers are clamped to.
pub const WIDEST: f64 = 5.0;
const EPSILON: f64 = 1e-5;

impl RunningMoments {
    /// Initial moments: mean 0, variance 1.
    pub fn new(columns: usize) -> Self {
        Self { mean: vec![0.0; columns], variance: vec![1.0; columns], count: 1.0 }
    }

    pub(super) fn of(rows: &[f64], columns: usize) -> Self {
        let n = (rows.len() / columns.max(1)) as f64;
        // Each thread sums whole columns in row order, so the bits do not depend on the number of threads.
        let means = |of: &[f64], square: bool| {
            let mut sums = vec![0.0; columns];
            let part = columns.div_ceil(rayon::current_num_threads()).max(4);
            sums.par_chunks_mut(part).zip(of.par_chunks(part)).enumerate().for_each(|(k, (sums, of))| {
                for row in rows.chunks_exact(columns) {
                    for (s, x, of) in izip!(&mut *sums, &row[k * part..], of) {
                        let x = x - of;
                        *s += if square { x * x } else { x };
                    }
                }
                sums.iter_mut().for_each(|s| *s /= n);
            });
            sums
        };
        let mean = means(&vec![0.0; columns], false);
        let variance = means(&mean, true);
        Self { mean, variance, count: n }
    }

    /// Updates the moments with `rows`.
    pub fn update(&mut self, rows: &[f64]) {
        self.absorb(&Self::of(rows, self.mean.len()));
    }

    /// Merges the moments of other rows.
    pub(super) fn absorb(&mut self, other: &Self) {
        let (n, m) = (self.count, other.count);
        if m == 0.0 {
            return;
        }
        let total = n + m;
        for k in 0..self.mean.len() {
            let d = other.mean[k] - self.mean[k];
            self.mean[k] += d * m / total;
            self.variance[k] = (n * self.variance[k] + m * other.variance[k] + d * d * n * m / total) / total;
        }
        self.count = total;
    }

    /// Normalises one number of a column and clamps it to +-5.
    pub fn normalize(&self, column: usize, x: f64) -> f64 {
        ((x - self.mean[column]) / self.scale(column)).clamp(-WIDEST, WIDEST)
    }

    pub(super) fn gradient(&self, column: usize, x: f64) -> f64 {
        let inside = (x - self.mean[column]).abs() < WIDEST * self.scale(column);
        if inside { self.scale(column).recip() } else { 0.0 }
    }

    /// Inverse of `normalize` within the bounds.
    pub fn restore(&self, column: usize, x: f64) -> f64 {
        x * self.scale(column) + self.mean[column]
    }

    /// Normalises rows into `out`, which is cleared first.
    pub fn rows(&self, rows: &[f64], out: &mut Vec<f32>) {
        let columns = self.mean.len();
        let inverse = (0..columns).map(|k| self.scale(k).recip()).collect_vec();
        out.clear();
        for row in rows.chunks_exact(columns) {
            let all = izip!(row, &self.mean, &inverse);
            out.extend(all.map(|(x, mean, inverse)| ((x - mean) * inverse).clamp(-WIDEST, WIDEST) as f32));
        }
    }

    /// Normalises rows as `rows` does, on all cores.
    pub fn all_rows(&self, rows: &[f64]) -> Vec<f32> {
        const ROWS: usize = 1024;
        let columns = self.mean.len();
        let parts = rows.par_chunks(ROWS * columns).map(|rows| {
            let mut out = Vec::with_capacity(rows.len());
            self.rows(rows, &mut out);
            out
        });
        parts.collect::<Vec<_>>().concat()
    }

    pub(crate) fn scale(&self, column: usize) -> f64 {
        (self.variance[column] + EPSILON).sqrt()
    }
}
