//! Analytic derivatives of inverse and forward dynamics, in one common frame. Source: Singh, Russell and Wensing,
//! "Efficient Analytical Derivatives of Rigid-Body Dynamics using Spatial Vector Algebra", RA-L 2022.

use nalgebra::{DMatrix, Matrix6};

use super::{Factor, crba, rnea};
use crate::{prelude::*, spatial::blocks};

/// Derivatives of a vector of length `nv` (`tau` or `qdd`) with respect to q and qd, each `nv` by `nv`.
///
/// Columns of `q` are tangent directions in the order of `qd`. For a floating root these are rotations about the world
/// axes (rad), then translations along the world axes (m); the joints follow. The numbers of `qd`, and of `qdd` or
/// `tau`, are held constant in the local form (see [`super::to_local`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Derivatives {
    /// With respect to q.
    pub q: DMatrix<f64>,
    /// With respect to qd.
    pub qd: DMatrix<f64>,
}

struct Column {
    dof: usize,
    link: usize,
    axis: Motion,
    /// `S' = v_p x S` and `S'' = a_p x S + v_p x S'`, with p the parent link.
    first: Motion,
    second: Motion,
}

/// Sums over each link's subtree: inertias, inertias of the gravity-compensated masses, matrices B (`b_matrix`),
/// forces and external wrenches.
struct Subtrees {
    inertia: Vec<Matrix6<f64>>,
    lifted: Vec<Matrix6<f64>>,
    b: Vec<Matrix6<f64>>,
    force: Vec<Wrench>,
    pushed: Vec<Wrench>,
}

impl Subtrees {
    fn new(robot: &Robot, gravity: &Vector3<f64>, external: &[Wrench], data: &Data) -> Self {
        let n = robot.links.len();
        let rise = Motion::new(Vector3::zeros(), *gravity);
        let mut inertia: Vec<Matrix6<f64>> = data.inertia.iter().map(SpatialInertia::matrix).collect();
        let point = |i: usize| {
            let PointMass { mass, at } = robot.links[i].lifted;
            let own = BodyInertia { mass, com: at, inertia: Matrix3::zeros() };
            SpatialInertia::of(&own, &data.rotation[i], &data.position[i]).matrix()
        };
        let mut lifted: Vec<Matrix6<f64>> = (0..n).map(point).collect();
        let mut b: Vec<Matrix6<f64>> =
            (0..n).map(|i| b_matrix(&data.inertia[i], &inertia[i], &data.velocity[i])).collect();
        let mut force: Vec<Wrench> = (0..n)
            .map(|i| {
                let own = &data.inertia[i];
                let v = &data.velocity[i];
                let weight = Wrench::from_slice((lifted[i] * rise.vector()).as_slice());
                own.apply(&data.acceleration[i]) + v.cross_wrench(&own.apply(v)) + weight
            })
            .collect();
        let mut pushed = external.to_vec();
        // From the leaves to the root.
        for i in (0..n).rev() {
            if let Some(p) = robot.links[i].parent {
                let own = inertia[i];
                let ol = lifted[i];
                let ob = b[i];
                let of = force[i];
                let oe = pushed[i];
                inertia[p] += own;
                lifted[p] += ol;
                b[p] += ob;
                force[p] += of;
                pushed[p] += oe;
            }
        }
        Self { inertia, lifted, b, force, pushed }
    }
}

/// Columns of a floating root's six DoFs, then of the joints in the order of their links.
fn columns(robot: &Robot, gravity: &Vector3<f64>, data: &Data) -> Vec<Column> {
    let base = Motion::new(Vector3::zeros(), -gravity);
    let column = |i: usize| {
        let (v, a) =
            robot.links[i].parent.map_or((Motion::default(), base), |p| (data.velocity[p], data.acceleration[p]));
        let axis = data.axis[i];
        let first = v.cross(&axis);
        Column { dof: data.dof[i], link: i, axis, first, second: a.cross(&axis) + v.cross(&first) }
    };
    let root = |k: usize| {
        let axis = Motion::unit(k);
        // Halves v x S: the derivatives count S' twice, but a root's axes, fixed in the world, need v x S once.
        Column { dof: k, link: 0, axis, first: data.velocity[0].cross(&axis) * 0.5, second: Motion::default() }
    };
    let roots: Vec<Column> = if robot.floating() { (0..6).map(root).collect() } else { Vec::new() };
    roots.into_iter().chain((usize::from(robot.floating())..robot.links.len()).map(column)).collect()
}

impl Derivatives {
    /// Zero derivatives for `robot`.
    pub fn new(robot: &Robot) -> Self {
        let nv = robot.nv();
        Self { q: DMatrix::zeros(nv, nv), qd: DMatrix::zeros(nv, nv) }
    }

    /// Derivatives of inverse dynamics: `tau` with respect to q and qd, at fixed `qdd`. Needs `kinematics`; fills
    /// `data.tau` and `data.mass`. External wrenches are held constant.
    ///
    /// `v` are twists and `a` accelerations (gravity included). f, `I` and `B` are the subtree sums of forces, inertias
    /// and `B = 1/2 (v x* I - I v x + (I v) x*)`. `S' = v_p x S` and `S'' = a_p x S + v_p x S'`, with p the parent:
    ///
    /// ```text
    /// d tau_i / d q_j  = S_i . (2 B S_j' + I S_j'')                 j at i or above, B and I of i
    /// d tau_i / d q_j  = S_i . (2 B S_j' + I S_j'' + S_j x* f)      j below i, B, I and f of j
    /// d tau_i / d qd_j = S_i . 2 (B S_j + I S_j')                   B and I of the lower one
    /// ```
    ///
    /// The gravity-compensated mass of a link feels `a` without gravity. So for its share of I, `S'' + g x S` takes the
    /// place of `S''`. A floating root's damping adds its matrix to the root's block of `d tau / d qd`.
    ///
    /// The dynamics do not depend on the root's position. To rotate a floating root is to rotate its velocities, its
    /// accelerations and gravity inversely.
    pub fn inverse(&mut self, robot: &Robot, qd: &[f64], qdd: &[f64], gravity: &Vector3<f64>, data: &mut Data) {
        crba(robot, data);
        rnea(robot, qd, qdd, gravity, data);
        let external = std::mem::take(&mut data.external);
        let sums = Subtrees::new(robot, gravity, &external, data);
        let columns = columns(robot, gravity, data);
        self.q.fill(0.0);
        self.qd.fill(0.0);
        self.pairs(robot, gravity, &sums, &columns);
        if robot.floating() {
            self.turn_root(qd, qdd, gravity, &sums, &columns, data);
            for (k, c) in (0..3).flat_map(|k| columns.iter().map(move |c| (k, c))) {
                let turned = Motion::new(Vector3::zeros(), Vector3::ith(k, 1.0).cross(gravity));
                self.q[(c.dof, k)] -= c.axis.vector().dot(&(sums.lifted[c.link] * turned.vector()));
            }
            (0..6).for_each(|k| self.qd[(k, k)] += robot.free.damping);
        }
        data.external = external;
    }

    /// For each joint, adds the derivatives of its torque with respect to the coordinates of itself and its ancestors.
    /// Also adds the derivatives of the ancestors' torques with respect to the joint's own coordinate.
    fn pairs(&mut self, robot: &Robot, gravity: &Vector3<f64>, sums: &Subtrees, columns: &[Column]) {
        let Subtrees { inertia, lifted, b, force, pushed } = sums;
        let rise = Motion::new(Vector3::zeros(), *gravity);
        // Offset between link index and column index: a floating root has six columns, a joint one.
        let lead = columns.len() - robot.links.len();
        for low in columns {
            let i = low.link;
            let own = low.axis.vector();
            let down = inertia[i] * own;
            let turned = b[i].transpose() * own * 2.0;
            let below = b[i] * low.first.vector() * 2.0
                + inertia[i] * low.second.vector()
                + lifted[i] * rise.cross(&low.axis).vector()
                + low.axis.cross_wrench(&force[i]).vector();
            let raised = lifted[i] * own;
            let rate = (b[i] * own + inertia[i] * low.first.vector()) * 2.0;
            // Columns of the joint of link i and of all joints above it.
            let of = |link: usize| {
                if robot.links[link].joint.is_some() { &columns[link + lead..=link + lead] } else { &columns[..6] }
            };
            for up in robot.ancestors(i).flat_map(of) {
                let (si, sj) = (low.dof, up.dof);
                self.q[(si, sj)] += turned.dot(&up.first.vector())
                    + down.dot(&up.second.vector())
                    + raised.dot(&rise.cross(&up.axis).vector())
                    - up.axis.cross(&low.axis).dot(&pushed[i]);
                self.qd[(si, sj)] += turned.dot(&up.axis.vector()) + 2.0 * down.dot(&up.first.vector());
                if up.link != i {
                    self.q[(sj, si)] += up.axis.vector().dot(&below);
                    self.qd[(sj, si)] += up.axis.vector().dot(&rate);
                }
            }
        }
    }

    /// Computes the columns of a floating root's rotation: the inverse rotation of its rates, its accelerations and
    /// gravity, and the rotation of the root's wrench.
    fn turn_root(
        &mut self,
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector3<f64>,
        Subtrees { force, pushed, .. }: &Subtrees,
        columns: &[Column],
        data: &Data,
    ) {
        let force = &force[0];
        self.q.columns_mut(0, 6).fill(0.0);
        for k in 0..3 {
            let e = Vector3::ith(k, 1.0);
            let turned = [vector(qd), vector(&qd[3..]), vector(qdd), vector(&qdd[3..]) - gravity].map(|x| e.cross(&x));
            for row in 0..self.q.nrows() {
                let sum: f64 = (0..3)
                    .map(|m| {
                        self.qd[(row, m)] * turned[0][m]
                            + self.qd[(row, 3 + m)] * turned[1][m]
                            + data.mass[(row, m)] * turned[2][m]
                            + data.mass[(row, 3 + m)] * turned[3][m]
                    })
                    .sum();
                self.q[(row, k)] = -sum;
            }
            let (n, f) = (e.cross(&force.ang), e.cross(&force.lin));
            (0..3).for_each(|m| {
                self.q[(m, k)] += n[m];
                self.q[(3 + m, k)] += f[m];
            });
            for low in columns.iter().filter(|c| c.dof >= 6) {
                self.q[(low.dof, k)] -= Motion::unit(k).cross(&low.axis).dot(&pushed[low.link]);
            }
        }
    }

    /// Derivatives of forward dynamics: `qdd` with respect to q and qd, at fixed `tau`. These derivatives are `-M^-1`
    /// times those of inverse dynamics at `qdd`; `d qdd / d tau` is `M^-1`. Needs `kinematics` and the accelerations
    /// `qdd`, for example from `aba`. Returns `false` if the mass matrix is not positive definite; the derivatives are
    /// then invalid.
    #[must_use = "without a mass matrix there are none"]
    pub fn forward(
        &mut self,
        robot: &Robot,
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector3<f64>,
        data: &mut Data,
        factor: &mut Factor,
    ) -> bool {
        self.inverse(robot, qd, qdd, gravity, data);
        if !factor.refill(&data.mass) {
            return false;
        }
        for matrix in [&mut self.q, &mut self.qd] {
            for mut column in matrix.column_iter_mut() {
                column.neg_mut();
                factor.solve(column.as_mut_slice());
            }
        }
        true
    }
}

/// `B = 1/2 (v x* I - I v x + (I v) x*)`, where `(f x*) m = m x* f`.
fn b_matrix(inertia: &SpatialInertia, matrix: &Matrix6<f64>, v: &Motion) -> Matrix6<f64> {
    let h = inertia.apply(v);
    let (w, l) = (v.ang.cross_matrix(), v.lin.cross_matrix());
    let motion = blocks(&w, &Matrix3::zeros(), &l, &w);
    // The matrix of v x* is minus the transpose of the matrix of v x.
    let carried = blocks(&-h.ang.cross_matrix(), &-h.lin.cross_matrix(), &-h.lin.cross_matrix(), &Matrix3::zeros());
    (-motion.transpose() * matrix - matrix * motion + carried) * 0.5
}
