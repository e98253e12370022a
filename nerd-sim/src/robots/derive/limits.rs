//! Default stiffness and damping of joint limits, as stiff as the reference simulator's substep `dt` allows.
//!
//! I is the least inertia felt at the joint with all other joints free, over a few poses. Stiffness is
//! `I (0.2 / dt)^2`. Stiffness is higher where the joint's effort would push the joint beyond an end of its range by
//! more than 4 % of the range. It is at most `I (2 / dt)^2`. Limits too stiff for an explicit substep are stepped
//! implicitly (`articulated/stiff.rs`). Damping is critical: `2 sqrt(I stiffness)`.

use nerd_core::dynamics::Inverse;

use crate::prelude::*;

/// Usual and largest `sqrt(stiffness dt^2 / I)`.
const USUAL_STIFFNESS: f64 = 0.2;
const MAX_STIFFNESS: f64 = 2.0;
/// Largest excess of a joint beyond an end under its effort, as a share of its range.
const MAX_EXCESS: f64 = 0.04;

/// Sets stiffness and damping of the limits marked in `missing`, by joint.
pub(crate) fn stiffen(robot: &mut Robot, missing: &[bool], dt: f64) {
    if !robot.joints().zip(missing).any(|(joint, missing)| *missing && joint.limit.is_some()) {
        return;
    }
    let inertias = least_inertias(robot);
    for ((joint, inertia), _) in robot.joints_mut().zip(inertias).zip(missing).filter(|(_, missing)| **missing) {
        let effort = joint.effort;
        if let Some(limit) = &mut joint.limit {
            let of = |a: f64| inertia * (a / dt).powi(2);
            // A joint without an effort needs no more than the usual stiffness.
            let effort = if effort.is_finite() { effort } else { 0.0 };
            let range = limit.upper - limit.lower;
            // A joint without a range is locked.
            let holding = if range > 0.0 { effort / (MAX_EXCESS * range) } else { f64::INFINITY };
            limit.stiffness = holding.clamp(of(USUAL_STIFFNESS), of(MAX_STIFFNESS));
            limit.damping = 2.0 * (inertia * limit.stiffness).sqrt();
        }
    }
}

/// For each joint, the least inertia (kg m^2 or kg) felt over several poses at rest, with all other joints free; 0
/// without inertia.
fn least_inertias(robot: &Robot) -> Vec<f64> {
    let joints = robot.joint_count();
    let dofs = robot.root_dofs();
    // The work grows with the square of the number of joints: robots with very many joints get one pose.
    let poses = (1_000_000 / (joints * joints)).clamp(1, 16);
    let mut data = Data::new(robot);
    let mut inverse = Inverse::new(robot);
    let mut x = vec![0.0; robot.nv()];
    let mut least = vec![f64::INFINITY; joints];
    for pose in 0..poses {
        kinematics(robot, &self::pose(robot, pose), &mut data);
        let resists = inverse.refill(robot, &mut data);
        if !resists {
            least.fill(0.0);
        }
        for (i, least) in least.iter_mut().enumerate().filter(|_| resists) {
            x.fill(0.0);
            x[dofs + i] = 1.0;
            inverse.solve(robot, &data, &mut x);
            *least = least.min(x[dofs + i].recip());
        }
    }
    least.iter().map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 }).collect()
}

/// Coordinates q of the `k`-th test pose. Pose 0 has the coordinates nearest to zero; the others follow a
/// low-discrepancy sequence within the joints' ranges.
pub(crate) fn pose(robot: &Robot, k: usize) -> Vec<f64> {
    let mut q = robot.neutral();
    let ends = |joint: &Joint| match joint.limit {
        Some(Limit { lower, upper, .. }) => (lower, upper),
        None if joint.kind == JointKind::Prismatic => (-1.0, 1.0),
        None => (-std::f64::consts::PI, std::f64::consts::PI),
    };
    for (i, (q, joint)) in q[robot.root_coords()..].iter_mut().zip(robot.joints()).enumerate() {
        let (lower, upper) = ends(joint);
        // Kronecker sequence: fractional parts of multiples of square roots.
        let share = (k as f64 * ((6 * i + 7) as f64).sqrt()).fract();
        *q = if k == 0 { 0.0f64.clamp(lower, upper) } else { lower + share * (upper - lower) };
    }
    q
}
