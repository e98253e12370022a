//! Sparse factorisation `M = L^T L` of the mass matrix.

use nalgebra::{DMatrix, SMatrix, SVector};

use crate::robot::Robot;

/// Lower-triangular factor of a mass matrix, allocated once and refilled.
///
/// `M = L^T L` keeps the tree's zeros (Featherstone 2008, section 6.5): row i of L is nonzero only at DoF i and its
/// ancestors. A chain of links costs as much as dense Cholesky; a star of legs costs far less.
#[derive(Clone, Debug)]
pub struct Factor {
    /// Rows of L, `nv` by `nv`, row-major. The diagonal is stored inverted, since a multiplication takes a quarter of
    /// the time of a division.
    rows: Vec<f64>,
    /// Parent of each DoF, or `usize::MAX` if it has none.
    parent: Vec<usize>,
    /// Number of leading DoFs that form a chain. The rows of these DoFs have no zeros, so `refill` updates the rows
    /// densely without `parent`.
    trunk: usize,
    /// Index of the DoF at which the last matrix failed to be positive definite.
    lost: usize,
}

/// A pivot below this share of the mass matrix's diagonal entry counts as rounding error.
const ROUNDING: f64 = 1e-12;

impl Factor {
    /// A factor for the mass matrix of `robot`.
    pub fn new(robot: &Robot) -> Self {
        let dofs = robot.root_dofs();
        let first = usize::from(robot.floating());
        let nv = robot.nv();
        let above = |link: usize| if robot.links[link].joint.is_some() { dofs + link - first } else { dofs - 1 };
        let parent: Vec<usize> = if robot.mimics() {
            // Mimic joints couple branches of the tree, so no entry is known to be zero.
            (0..nv).map(|k| k.wrapping_sub(1)).collect()
        } else {
            let root = (0..dofs).map(|k| k.wrapping_sub(1));
            root.chain(robot.links[first..].iter().map(|l| l.parent.map_or(usize::MAX, above))).collect()
        };
        let trunk = parent.iter().enumerate().take_while(|(k, p)| k.wrapping_sub(1) == **p).count();
        Self { rows: vec![0.0; nv * nv], parent, trunk, lost: 0 }
    }

    /// Parent of each DoF, `None` for the first DoF of a tree. The row of a DoF may be nonzero only at its ancestors.
    pub fn above(&self) -> impl Iterator<Item = Option<usize>> {
        self.parent.iter().map(|p| (*p != usize::MAX).then_some(*p))
    }

    /// Factorises `mass`; reads only its lower triangle. Returns `false` if `mass` is not positive definite; then do
    /// not solve.
    #[must_use]
    pub fn refill(&mut self, mass: &DMatrix<f64>) -> bool {
        let n = self.parent.len();
        let parent = &self.parent;
        let trunk = self.trunk;
        for k in 0..n {
            let row = &mut self.rows[k * n..][..n];
            let mut i = k;
            while i != usize::MAX {
                row[i] = mass[(k, i)];
                i = parent[i];
            }
        }
        for k in (0..n).rev() {
            let (above, row) = self.rows.split_at_mut(k * n);
            let row = &mut row[..n];
            if row[k].is_nan() || row[k] <= ROUNDING * mass[(k, k)] {
                self.lost = k;
                return false;
            }
            row[k] = row[k].sqrt().recip();
            let inverse = row[k];
            let mut i = parent[k];
            while i != usize::MAX {
                row[i] *= inverse;
                i = parent[i];
            }
            let mut i = parent[k];
            while i != usize::MAX {
                let target = &mut above[i * n..][..n];
                let by = row[i];
                let mut j = i;
                while j != usize::MAX && j >= trunk {
                    target[j] -= by * row[j];
                    j = parent[j];
                }
                // At the root j is `usize::MAX`, so the end wraps to 0.
                let end = j.wrapping_add(1);
                target[..end].iter_mut().zip(&row[..end]).for_each(|(t, r)| *t -= by * r);
                i = parent[i];
            }
        }
        true
    }

    /// Error text that names the joint at which the last matrix was not positive definite.
    pub fn fault(&self, robot: &Robot) -> String {
        self.fault_at(robot, None)
    }

    /// Like `Self::fault`, for another factorisation that failed at DoF `lost`.
    pub fn fault_at(&self, robot: &Robot, lost: Option<usize>) -> String {
        let joint = lost.unwrap_or(self.lost).checked_sub(robot.root_dofs()).and_then(|i| robot.joints().nth(i));
        let place =
            joint.map_or_else(|| format!("the free root `{}`", robot.links[0].name), |j| format!("joint `{}`", j.name));
        format!("the mass matrix is not positive definite at {place}: a link without inertia, or a state out of bounds")
    }

    /// Inverse effective mass `X^T M^-1 X` (N by N), with the rows of X in `x[nv]`. X must be zero except at the DoF
    /// `last` and its ancestors. Overwrites `x`.
    pub fn inv_mass<const N: usize>(&self, last: usize, x: &mut [SVector<f64, N>]) -> SMatrix<f64, N, N> {
        let n = self.parent.len();
        let mut sum = SMatrix::zeros();
        let mut i = last;
        while i != usize::MAX {
            let row = &self.rows[i * n..][..n];
            let by = x[i] * row[i];
            let mut j = self.parent[i];
            while j != usize::MAX {
                x[j] -= by * row[j];
                j = self.parent[j];
            }
            sum += by * by.transpose();
            i = self.parent[i];
        }
        sum
    }

    /// Solves `M x = b` in place in `x[nv]`: first `L^T y = b`, then `L x = y`.
    #[inline]
    pub fn solve(&self, x: &mut [f64]) {
        let n = self.parent.len();
        let parent = &self.parent;
        let x = &mut x[..n];
        for i in (0..n).rev() {
            let row = &self.rows[i * n..][..n];
            let mut j = parent[i];
            x[i] *= row[i];
            let by = x[i];
            while j != usize::MAX {
                x[j] -= row[j] * by;
                j = parent[j];
            }
        }
        for i in 0..n {
            let row = &self.rows[i * n..][..n];
            let mut sum = x[i];
            let mut j = parent[i];
            while j != usize::MAX {
                sum -= row[j] * x[j];
                j = parent[j];
            }
            x[i] = sum * row[i];
        }
    }
}
