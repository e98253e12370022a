//! Motors of a robot without TOML: efforts, random torques, and rotors of joints without other inertia.

use nerd_core::dynamics::TreeFactor;

use super::limits::pose;
use super::plain::rounded;
use crate::internal::*;

/// Acceleration (rad/s^2 or m/s^2) of a joint under random torques, in addition to the torque that holds the joint
/// against gravity.
const RANDOM_ACCELERATION: f64 = 20.0;
/// Time (s) that a motor's effort takes to accelerate its rotor to the joint's velocity limit.
pub(super) const ROTOR_START_TIME: f64 = 0.01;
/// Assumed effort of a motor without data: the larger of two torques. One carries the robot's weight on this share of a
/// foot's lever about the joint. The other holds `HELD_MASS_RATIO` times the weight of the links that the joint moves.
const BORNE_WEIGHT_SHARE: f64 = 0.75;
const HELD_MASS_RATIO: f64 = 3.0;
/// Least assumed effort, as a share of the largest effort of the robot's joints.
const MIN_EFFORT_SHARE: f64 = 0.05;
/// Velocity limit (rad/s, m/s) of a motor without data.
const ASSUMED_VELOCITY_LIMIT: f64 = 20.0;

/// Efforts of the motors by joint (N m or N), estimated where the file has none. `lows` are the heights of contact
/// points; points below `ground` may carry the robot.
pub(super) fn efforts(robot: &Robot, data: &Data, lows: &[f64], ground: f64) -> Vec<f64> {
    let n = robot.links.len();
    let over = |link: usize, joint: usize| robot.ancestors(link).any(|k| k == joint);
    let first = n - robot.joint_count();
    let effort = |(link, joint): (usize, &Joint)| {
        if joint.effort.is_finite() {
            return joint.effort;
        }
        let axis = data.rotation[link] * joint.axis().into_inner();
        let lever = |place: Vector3<f64>| match joint.kind {
            JointKind::Prismatic => 1.0,
            _ => axis.cross(&(place - data.origin - data.position[link])).norm(),
        };
        let feet = robot.contact_points.iter().zip(lows).filter(|(p, at)| **at < ground && over(p.link, link));
        let foot = feet.map(|(p, _)| lever(point_position(data, p.link, &p.local))).fold(0.0, f64::max);
        let own = |k: usize| robot.links[k].inertia.mass * lever(point_position(data, k, &robot.links[k].inertia.com));
        let own: f64 = (link..n).filter(|k| over(*k, link)).map(own).sum();
        rounded(GRAVITY * (BORNE_WEIGHT_SHARE * robot.mass() * foot).max(HELD_MASS_RATIO * own))
    };
    let all: Vec<f64> = (first..n).zip(robot.joints()).map(effort).collect();
    // A joint with an axis through its load carries nothing, but still has a motor.
    let least = rounded(MIN_EFFORT_SHARE * all.iter().copied().fold(0.0, f64::max));
    all.into_iter()
        .zip(robot.joints())
        .map(|(x, joint)| if joint.effort.is_finite() { x } else { x.max(least) })
        .collect()
}

/// Inertia of a motor's rotor felt at its joint (kg m^2 or kg). Without an effort in the file, `effort` is used; 0 if
/// that is missing, too.
pub(crate) fn rotor(joint: &Joint, effort: Option<f64>) -> f64 {
    let effort = Some(joint.effort).filter(|x| x.is_finite()).or(effort);
    let velocity =
        if joint.velocity.is_finite() && joint.velocity > 0.0 { joint.velocity } else { ASSUMED_VELOCITY_LIMIT };
    effort.map_or(0.0, |effort| rounded(effort * ROTOR_START_TIME / velocity))
}

/// For each joint, the joint if it has no inertia in some test pose, else `None`. `least`: largest inertia (kg m^2 or
/// kg) that counts as zero.
pub(super) fn bare(robot: &Robot, least: f64) -> Vec<Option<Joint>> {
    let mut bare = vec![None; robot.joint_count()];
    let Some(mut tree) = TreeFactor::new(robot) else { return bare };
    let mut heavier = robot.clone();
    let mut data = Data::new(robot);
    let dofs = robot.root_dofs();
    for k in 0..8 {
        kinematics(robot, &pose(robot, k), &mut data);
        inertias(robot, &mut data);
        loop {
            let found = if tree.refill(&heavier, &data, &[], &[]) {
                tree.spread(&heavier, &data);
                let inv_masses =
                    (0..bare.len()).map(|i| (i, tree.inv_mass(&heavier, i + usize::from(robot.floating()))));
                inv_masses
                    .filter(|(_, inv_mass)| inv_mass.is_nan() || inv_mass * least >= 1.0)
                    .max_by(|a, b| a.1.total_cmp(&b.1))
                    .map(|(i, _)| i)
            } else {
                tree.lost().checked_sub(dofs)
            };
            // A joint that already has armature fails for another reason.
            let Some(i) = found.filter(|i| bare[*i].is_none()) else { break };
            for joint in heavier.joints_mut().skip(i).take(1) {
                bare[i] = Some(joint.clone());
                joint.armature = 1.0;
            }
        }
    }
    bare
}

/// Amplitudes of random torques (N m or N) by joint, at most the joint's effort. The amplitude is the largest gravity
/// torque over a few poses (fixed base only) plus the torque that accelerates the joint by [`RANDOM_ACCELERATION`].
pub(super) fn torques(robot: &Robot, up: &Vector3<f64>) -> Vec<f64> {
    let mut data = Data::new(robot);
    let rest = vec![0.0; robot.nv()];
    let dofs = robot.root_dofs();
    let mut most = vec![0.0f64; robot.joint_count()];
    for k in 0..8 {
        kinematics(robot, &pose(robot, k), &mut data);
        crba(robot, &mut data);
        bias(robot, &rest, &(-GRAVITY * up), &mut data);
        for (i, most) in most.iter_mut().enumerate() {
            let holds = if robot.floating() { 0.0 } else { data.tau[dofs + i].abs() };
            *most = most.max(holds + RANDOM_ACCELERATION * data.mass[(dofs + i, dofs + i)]);
        }
    }
    robot.joints().zip(&most).map(|(joint, most)| rounded(*most).min(joint.effort)).collect()
}
