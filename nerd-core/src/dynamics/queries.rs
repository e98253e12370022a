//! Dynamics of a robot as single calls on `Data`: CRBA, RNEA, ABA and their derivatives. Each call also computes the
//! kinematics at `q`.
//!
//! Accelerations here are time derivatives of a [`LocalVelocity`]. The stages use spatial accelerations, in which the
//! linear part of a floating root lacks the term `w x p_dot` ([`super`]). The methods here convert between these two
//! forms of acceleration.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::{Data, Derivatives, Factor, aba, crba, kinematics, rnea};
use crate::{robot::Robot, state::vector, velocity::LocalVelocity};

/// The error of forward dynamics: some link has no inertia, or an input is not finite, so no acceleration is defined.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct NoInertia(String);

impl Data {
    /// Mass matrix M (CRBA), `nv` by `nv`, in `M(q) qdd + c(q, qd) = tau`.
    pub fn mass_matrix(&mut self, robot: &Robot, q: &[f64]) -> &DMatrix<f64> {
        self.place(robot, q);
        crba(robot, self);
        &self.mass
    }

    /// Torques `[nv]` (N m, N) that hold the robot still under `gravity` (m/s^2, world axes).
    pub fn gravity_torque(&mut self, robot: &Robot, q: &[f64], gravity: &Vector3<f64>) -> &DVector<f64> {
        self.torques(robot, q, None, None, gravity)
    }

    /// Bias forces `c(q, qd)`, `[nv]`: gravity, Coriolis and centrifugal terms, minus the torques of external wrenches.
    pub fn bias(
        &mut self,
        robot: &Robot,
        q: &[f64],
        qd: &LocalVelocity<impl AsRef<[f64]>>,
        gravity: &Vector3<f64>,
    ) -> &DVector<f64> {
        self.torques(robot, q, Some(qd.0.as_ref()), None, gravity)
    }

    /// Inverse dynamics (RNEA): the torques `[nv]` that cause the accelerations `qdd[nv]`.
    pub fn inverse_dynamics(
        &mut self,
        robot: &Robot,
        q: &[f64],
        qd: &LocalVelocity<impl AsRef<[f64]>>,
        qdd: &[f64],
        gravity: &Vector3<f64>,
    ) -> &DVector<f64> {
        self.torques(robot, q, Some(qd.0.as_ref()), Some(qdd), gravity)
    }

    /// Forward dynamics (ABA): the accelerations `[nv]` that the torques `tau[nv]` cause.
    ///
    /// # Errors
    /// If a link has no inertia to accelerate, or an input is not finite; the error names the joint.
    pub fn forward_dynamics(
        &mut self,
        robot: &Robot,
        q: &[f64],
        qd: &LocalVelocity<impl AsRef<[f64]>>,
        tau: &[f64],
        gravity: &Vector3<f64>,
    ) -> Result<&DVector<f64>, NoInertia> {
        let qd = qd.0.as_ref();
        self.place(robot, q);
        if !aba(robot, qd, tau, gravity, self) {
            return Err(self.no_inertia(robot));
        }
        shift(robot, qd, self.qdd.as_mut_slice(), 1.0);
        Ok(&self.qdd)
    }

    /// Derivatives of [`Data::inverse_dynamics`] with respect to `q` and `qd`, at fixed `qdd`; `d tau / d qdd` is the
    /// mass matrix.
    pub fn inverse_derivatives(
        &mut self,
        robot: &Robot,
        q: &[f64],
        qd: &LocalVelocity<impl AsRef<[f64]>>,
        qdd: &[f64],
        gravity: &Vector3<f64>,
    ) -> Derivatives {
        let qd = qd.0.as_ref();
        let mut spatial = qdd.to_vec();
        let mut out = Derivatives::new(robot);
        shift(robot, qd, &mut spatial, -1.0);
        self.place(robot, q);
        out.inverse(robot, qd, &spatial, gravity, self);
        if robot.floating() {
            let [by_w, by_v] = shift_rates(qd);
            let linear = self.mass.columns(3, 3).into_owned();
            let (w, v) = (&linear * by_w, &linear * by_v);
            out.qd.columns_mut(0, 3).zip_apply(&w, |x, y| *x -= y);
            out.qd.columns_mut(3, 3).zip_apply(&v, |x, y| *x -= y);
        }
        out
    }

    /// Derivatives of [`Data::forward_dynamics`] with respect to `q` and `qd`, at fixed `tau`; `d qdd / d tau` is the
    /// inverse mass matrix.
    pub fn forward_derivatives(
        &mut self,
        robot: &Robot,
        q: &[f64],
        qd: &LocalVelocity<impl AsRef<[f64]>>,
        tau: &[f64],
        gravity: &Vector3<f64>,
    ) -> Result<Derivatives, NoInertia> {
        let qd = qd.0.as_ref();
        let mut out = Derivatives::new(robot);
        self.place(robot, q);
        if !aba(robot, qd, tau, gravity, self) {
            return Err(self.no_inertia(robot));
        }
        let spatial = self.qdd.as_slice().to_vec();
        let mut factor = Factor::new(robot);
        if !out.forward(robot, qd, &spatial, gravity, self, &mut factor) {
            return Err(NoInertia(factor.fault(robot)));
        }
        if robot.floating() {
            let [by_w, by_v] = shift_rates(qd);
            let mut w = out.qd.fixed_view_mut::<3, 3>(3, 0);
            w += by_w;
            let mut v = out.qd.fixed_view_mut::<3, 3>(3, 3);
            v += by_v;
        }
        Ok(out)
    }

    /// Computes the kinematics at `q`. Panics if `q` or this `Data` has the wrong length, which is a bug in the calling
    /// program.
    pub(super) fn place(&mut self, robot: &Robot, q: &[f64]) {
        assert!(
            q.len() >= robot.nq(),
            "q has {} numbers, robot `{}` has {} coordinates",
            q.len(),
            robot.name,
            robot.nq()
        );
        assert!(self.tau.len() == robot.nv(), "this Data was made for another robot than `{}`", robot.name);
        kinematics(robot, q, self);
    }

    /// Writes the torques of RNEA to `self.tau`; a missing velocity or acceleration counts as zero.
    fn torques(
        &mut self,
        robot: &Robot,
        q: &[f64],
        qd: Option<&[f64]>,
        qdd: Option<&[f64]>,
        gravity: &Vector3<f64>,
    ) -> &DVector<f64> {
        self.place(robot, q);
        let mut spatial = std::mem::replace(&mut self.qdd, DVector::zeros(0));
        match qdd {
            Some(qdd) => spatial.copy_from_slice(qdd),
            None => spatial.fill(0.0),
        }
        match qd {
            Some(qd) => {
                shift(robot, qd, spatial.as_mut_slice(), -1.0);
                rnea(robot, qd, spatial.as_slice(), gravity, self);
            }
            None => rnea(robot, spatial.as_slice(), spatial.as_slice(), gravity, self),
        }
        self.qdd = spatial;
        &self.tau
    }

    #[cold]
    fn no_inertia(&mut self, robot: &Robot) -> NoInertia {
        let mut factor = Factor::new(robot);
        crba(robot, self);
        let sound = factor.refill(&self.mass);
        NoInertia(if sound { "the state or a torque is not finite".into() } else { factor.fault(robot) })
    }
}

/// Adds `sign (w x p_dot)` of a floating root to its linear part of `qdd`. `sign` +1 converts spatial accelerations to
/// time derivatives of `p_dot`; -1 converts back.
fn shift(robot: &Robot, qd: &[f64], qdd: &mut [f64], sign: f64) {
    if robot.floating() {
        let turning = vector(qd).cross(&vector(&qd[3..6]));
        (0..3).for_each(|k| qdd[3 + k] += sign * turning[k]);
    }
}

/// Derivatives (3 by 3) of `w x p_dot` with respect to w and to `p_dot`.
fn shift_rates(qd: &[f64]) -> [Matrix3<f64>; 2] {
    [-vector(&qd[3..6]).cross_matrix(), vector(qd).cross_matrix()]
}
