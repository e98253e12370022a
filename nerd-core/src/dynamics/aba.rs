//! Forward dynamics.

use nalgebra::{DVector, Vector3};

use super::{Data, bias, crba, inertias, tree::Inverse};
use crate::robot::Robot;

/// Accelerations `M^-1 (tau - c)` into `data.qdd` for torques `tau` and local velocities `qd` (length `nv`). Needs
/// `kinematics`; honours `data.external`. Returns `false` if a subtree has no inertia to accelerate.
///
/// Articulated bodies, in O(n): the bias by [`bias`], the inverse by [`super::TreeFactor`].
#[must_use = "without inertia there is no acceleration"]
pub fn aba(robot: &Robot, qd: &[f64], tau: &[f64], gravity: &Vector3<f64>, data: &mut Data) -> bool {
    bias(robot, qd, gravity, data);
    let mut inverse = data.inverse.take().unwrap_or_else(|| Box::new(Inverse::new(robot)));
    let mut qdd = std::mem::replace(&mut data.qdd, DVector::zeros(0));
    qdd.iter_mut().zip(tau.iter().zip(data.tau.iter())).for_each(|(a, (tau, c))| *a = tau - c);
    let sound = match &mut *inverse {
        Inverse::Tree(tree) => {
            inertias(robot, data);
            let sound = tree.refill(robot, data, &[], &[]);
            if sound {
                tree.solve(robot, data, &[], qdd.as_mut_slice());
            }
            sound
        }
        Inverse::Matrix(factor) => {
            crba(robot, data);
            let sound = factor.refill(&data.mass);
            if sound {
                factor.solve(qdd.as_mut_slice());
            }
            sound
        }
    };
    (data.inverse, data.qdd) = (Some(inverse), qdd);
    sound
}
