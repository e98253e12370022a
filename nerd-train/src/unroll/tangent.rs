//! Small changes of a state: `[position, rotation vector (world axes), joints, qd]` of a floating robot, else `[joints, qd]`; as many as
//! twice its degrees of freedom.

use nalgebra::{UnitQuaternion, Vector3};
use nerd_core::robot::Robot;
use nerd_core::state::{quaternion, wrap, write_quaternion};

/// Numbers of a change.
pub fn dim(robot: &Robot) -> usize {
    2 * robot.nv()
}

/// Moves a state by `by` along number `k` of a change.
pub fn shift(robot: &Robot, state: &mut [f64], k: usize, by: f64) {
    let nv = robot.nv();
    match k {
        _ if k >= nv => state[robot.nq() + k - nv] += by,
        3..6 if robot.floating() => {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::ith(k - 3, by));
            let turned = turn * quaternion(&state[3..7]);
            write_quaternion(&mut state[3..7], &turned);
        }
        // A quaternion has a number more than a rotation vector.
        _ => state[if robot.floating() && k > 5 { k + 1 } else { k }] += by,
    }
}

/// The change from state `a` to state `b`.
pub fn apart(robot: &Robot, a: &[f64], b: &[f64], out: &mut [f64]) {
    let (nq, nv, root) = (robot.nq(), robot.nv(), robot.root_coords());
    if robot.floating() {
        (0..3).for_each(|k| out[k] = b[k] - a[k]);
        let turn = (quaternion(&b[3..7]) * quaternion(&a[3..7]).inverse()).scaled_axis();
        out[3..6].copy_from_slice(turn.as_slice());
    }
    for (k, joint) in robot.joints().enumerate() {
        let d = b[root + k] - a[root + k];
        out[robot.root_dofs() + k] = if joint.wraps() { wrap(d) } else { d };
    }
    (0..nv).for_each(|k| out[nv + k] = b[nq + k] - a[nq + k]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use nerd_sim::prelude::*;

    #[test]
    fn a_change_is_the_way_between_two_states() -> Result<(), SystemError> {
        let robot = &System::named("ant")?.robot;
        let mut from: Vec<f64> = (0..robot.state_dim()).map(|k| 0.1 + 0.03 * k as f64).collect();
        write_quaternion(&mut from[3..7], &UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -0.2, 0.9)));
        for k in 0..dim(robot) {
            let (mut to, mut out) = (from.clone(), vec![0.0; dim(robot)]);
            shift(robot, &mut to, k, 1e-3);
            apart(robot, &from, &to, &mut out);
            out[k] -= 1e-3;
            let most = out.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            assert!(most < 1e-12, "number {k}: {most:e} off");
        }
        Ok(())
    }
}
