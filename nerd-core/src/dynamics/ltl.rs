//! The mass matrix's factor.

use nalgebra::DMatrix;

use crate::robot::Robot;

/// Lower-triangular factor of a mass matrix; made once, refilled at will.
///
/// Factorisation `M = L^T L` that keeps the tree's zeros (Featherstone 2008, section 6.5): row i of L is nonzero only
/// at i and its ancestors, so a chain costs what dense Cholesky does and a star of legs far less.
#[derive(Clone, Debug)]
pub struct Factor {
    /// Rows of L, its diagonal inverted: a product is a quarter of the time of a division.
    rows: DMatrix<f64>,
    /// DoF above each DoF, or `usize::MAX`.
    parent: Vec<usize>,
    /// DoF at which the last matrix was found wanting.
    lost: usize,
}

/// What is left on the diagonal below this share of what was there is rounding.
const ROUNDING: f64 = 1e-12;

impl Factor {
    /// Room for the mass matrix of `robot`.
    pub fn new(robot: &Robot) -> Self {
        let (dofs, first, nv) = (robot.root_dofs(), usize::from(robot.floating()), robot.nv());
        // Joints that follow others couple branches of the tree: then no entry is known to be zero.
        if robot.mimics() {
            return Self { rows: DMatrix::zeros(nv, nv), parent: (0..nv).map(|k| k.wrapping_sub(1)).collect(), lost: 0 };
        }
        let root = (0..dofs).map(|k| k.wrapping_sub(1));
        let above = |link: usize| if robot.links[link].joint.is_some() { dofs + link - first } else { dofs - 1 };
        let joints = robot.links[first..].iter().map(|l| l.parent.map_or(usize::MAX, above));
        Self { rows: DMatrix::zeros(nv, nv), parent: root.chain(joints).collect(), lost: 0 }
    }

    /// The DoF above each DoF, whose columns its row may fill; none above a root.
    pub fn above(&self) -> impl Iterator<Item = Option<usize>> {
        self.parent.iter().map(|p| (*p != usize::MAX).then_some(*p))
    }

    /// Factorises `mass` (its lower triangle is read). `false` if it is not positive definite; then do not solve.
    #[must_use]
    pub fn refill(&mut self, mass: &DMatrix<f64>) -> bool {
        self.rows.copy_from(mass);
        let (l, parent) = (&mut self.rows, &self.parent);
        for k in (0..parent.len()).rev() {
            let square = l[(k, k)];
            if square.is_nan() || square <= ROUNDING * mass[(k, k)] {
                self.lost = k;
                return false;
            }
            let inverse = square.sqrt().recip();
            l[(k, k)] = inverse;
            let mut i = parent[k];
            while i != usize::MAX {
                l[(k, i)] *= inverse;
                i = parent[i];
            }
            let mut i = parent[k];
            while i != usize::MAX {
                let mut j = i;
                while j != usize::MAX {
                    l[(i, j)] -= l[(k, i)] * l[(k, j)];
                    j = parent[j];
                }
                i = parent[i];
            }
        }
        true
    }

    /// Why the last matrix was not positive definite.
    pub fn fault(&self, robot: &Robot) -> String {
        self.fault_at(robot, None)
    }

    /// The same, but at a DoF that something else found wanting.
    pub fn fault_at(&self, robot: &Robot, lost: Option<usize>) -> String {
        let joint = lost.unwrap_or(self.lost).checked_sub(robot.root_dofs()).and_then(|i| robot.joints().nth(i));
        let place = joint.map_or_else(|| format!("the free root `{}`", robot.links[0].name), |j| format!("joint `{}`", j.name));
        format!("the mass matrix is not positive definite at {place}: a link without inertia, or a state out of bounds")
    }

    /// Replaces `x` by `M^-1 x`: `L^T y = x`, then `L z = y`.
    #[inline]
    pub fn solve(&self, x: &mut [f64]) {
        let (l, parent) = (&self.rows, &self.parent);
        for i in (0..x.len()).rev() {
            x[i] *= l[(i, i)];
            let mut j = parent[i];
            while j != usize::MAX {
                x[j] -= l[(i, j)] * x[i];
                j = parent[j];
            }
        }
        for i in 0..x.len() {
            let mut j = parent[i];
            while j != usize::MAX {
                x[i] -= l[(i, j)] * x[j];
                j = parent[j];
            }
            x[i] *= l[(i, i)];
        }
    }
}
