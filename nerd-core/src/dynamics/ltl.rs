//! The mass matrix's factor.

use nalgebra::DMatrix;

use crate::robot::Robot;

/// Lower-triangular factor of a mass matrix; made once, refilled at will.
///
/// Factorisation `M = L^T L` that keeps the tree's zeros (Featherstone 2008, section 6.5): row i of L is nonzero only at i and its
/// ancestors. A chain costs as much as dense Cholesky, a star of legs far less.
#[derive(Clone, Debug)]
pub struct Factor {
    /// Rows of L one after another, their diagonal inverted: a multiplication takes a quarter of the time of a division.
    rows: Vec<f64>,
    /// DoF above each DoF, or `usize::MAX`.
    parent: Vec<usize>,
    /// Number of leading DoFs that form a chain: their rows have no zeros, so `parent` is not read for them.
    trunk: usize,
    /// DoF at which the last matrix was found not positive definite.
    lost: usize,
}

/// A pivot below this share of the original diagonal entry is rounding.
const ROUNDING: f64 = 1e-12;

impl Factor {
    /// Room for the mass matrix of `robot`.
    pub fn new(robot: &Robot) -> Self {
        let (dofs, first, nv) = (robot.root_dofs(), usize::from(robot.floating()), robot.nv());
        let above = |link: usize| if robot.links[link].joint.is_some() { dofs + link - first } else { dofs - 1 };
        let parent: Vec<usize> = if robot.mimics() {
            // Joints that follow others couple branches of the tree, so no entry is known to be zero.
            (0..nv).map(|k| k.wrapping_sub(1)).collect()
        } else {
            let root = (0..dofs).map(|k| k.wrapping_sub(1));
            root.chain(robot.links[first..].iter().map(|l| l.parent.map_or(usize::MAX, above))).collect()
        };
        let trunk = parent.iter().enumerate().take_while(|(k, p)| k.wrapping_sub(1) == **p).count();
        Self { rows: vec![0.0; nv * nv], parent, trunk, lost: 0 }
    }

    /// The DoF above each DoF, whose columns its row may fill; none above a root.
    pub fn above(&self) -> impl Iterator<Item = Option<usize>> {
        self.parent.iter().map(|p| (*p != usize::MAX).then_some(*p))
    }

    /// Factorises `mass` (its lower triangle is read). `false` if it is not positive definite; then do not solve.
    #[must_use]
    pub fn refill(&mut self, mass: &DMatrix<f64>) -> bool {
        let (n, parent, trunk) = (self.parent.len(), &self.parent, self.trunk);
        for k in 0..n {
            let (row, mut i) = (&mut self.rows[k * n..][..n], k);
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
                let (target, by) = (&mut above[i * n..][..n], row[i]);
                let mut j = i;
                while j != usize::MAX && j >= trunk {
                    target[j] -= by * row[j];
                    j = parent[j];
                }
                // No row is left after a root: then the end is 0.
                let end = j.wrapping_add(1);
                target[..end].iter_mut().zip(&row[..end]).for_each(|(t, r)| *t -= by * r);
                i = parent[i];
            }
        }
        true
    }

    /// Why the last matrix was not positive definite.
    pub fn fault(&self, robot: &Robot) -> String {
        self.fault_at(robot, None)
    }

    /// The same, at a DoF that another solver found not positive definite.
    pub fn fault_at(&self, robot: &Robot, lost: Option<usize>) -> String {
        let joint = lost.unwrap_or(self.lost).checked_sub(robot.root_dofs()).and_then(|i| robot.joints().nth(i));
        let place = joint.map_or_else(|| format!("the free root `{}`", robot.links[0].name), |j| format!("joint `{}`", j.name));
        format!("the mass matrix is not positive definite at {place}: a link without inertia, or a state out of bounds")
    }

    /// `x^T M^-1 x = |L^-T x|^2` for an x that is zero except at the DoF `last` and its ancestors. Overwrites x.
    pub fn ease(&self, last: usize, x: &mut [f64]) -> f64 {
        let (n, mut sum, mut i) = (self.parent.len(), 0.0, last);
        while i != usize::MAX {
            let row = &self.rows[i * n..][..n];
            x[i] *= row[i];
            let (by, mut j) = (x[i], self.parent[i]);
            while j != usize::MAX {
                x[j] -= row[j] * by;
                j = self.parent[j];
            }
            sum += by * by;
            i = self.parent[i];
        }
        sum
    }

    /// Replaces `x` by `M^-1 x`: `L^T y = x`, then `L z = y`.
    #[inline]
    pub fn solve(&self, x: &mut [f64]) {
        let (n, parent) = (self.parent.len(), &self.parent);
        let x = &mut x[..n];
        for i in (0..n).rev() {
            let (row, mut j) = (&self.rows[i * n..][..n], parent[i]);
            x[i] *= row[i];
            let by = x[i];
            while j != usize::MAX {
                x[j] -= row[j] * by;
                j = parent[j];
            }
        }
        for i in 0..n {
            let row = &self.rows[i * n..][..n];
            let (mut sum, mut j) = (x[i], parent[i]);
            while j != usize::MAX {
                sum -= row[j] * x[j];
                j = parent[j];
            }
            x[i] = sum * row[i];
        }
    }
}
