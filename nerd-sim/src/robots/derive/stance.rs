//! A standing pose for a legged robot with joints that cannot be at zero. Each foot is below its hip, at a share of the
//! leg's reach. Links above the legs, such as a waist, and arms keep their positions.

use super::{leg::Leg, limbs::Limbs, limits::pose};
use crate::internal::*;

/// Height of a hip above its foot, as a share of the leg's largest reach over some poses.
const HIP_HEIGHT_SHARE: f64 = 0.8;
/// Largest distance of a foot from its target, and (`MAX_FOOT_HEIGHT_DIFFERENCE`) largest height difference between
/// standing feet, as shares of the leg's reach.
const MAX_FOOT_ERROR: f64 = 0.05;
const MAX_FOOT_HEIGHT_DIFFERENCE: f64 = 0.01;
/// Number of poses sampled for the reach.
const REACH_POSES: usize = 256;

/// Bends the legs of a robot on a free base if a joint cannot be at zero and the feet are not yet below the hips.
/// Returns whether `state` changed. Nothing changes if a leg cannot place its foot, for instance with one hinge.
pub(super) fn bend(robot: &Robot, state: &mut [f64], up: &Vector3<f64>) -> bool {
    let mut tried = state.to_vec();
    let bent = robot.floating() && !robot.mimics() && bent(robot, &mut tried, up);
    if bent {
        state.copy_from_slice(&tried);
    }
    bent
}

fn bent(robot: &Robot, state: &mut [f64], up: &Vector3<f64>) -> bool {
    let limbs = Limbs::new(robot, state, up);
    let mut data = Data::new(robot);
    let mut straight = state.to_vec();
    straight[robot.root_coords()..].fill(0.0);
    kinematics(robot, &straight, &mut data);
    let mut legs: Vec<Leg> =
        limbs.hips().into_iter().filter_map(|hip| Leg::new(robot, &data, up, limbs.all(hip))).collect();
    let joint = |link: &usize| robot.links[*link].joint.as_ref();
    let apart = |link: &&usize| {
        joint(link).and_then(|joint| joint.limit).is_some_and(|limit| limit.lower > 0.0 || limit.upper < 0.0)
    };
    if !legs.iter().flat_map(|leg| &leg.links).any(|link| apart(&link)) {
        return false;
    }
    for leg in &mut legs {
        let drop = |k: usize| {
            let mut tried = state.to_vec();
            let drawn = pose(robot, k);
            let at = |link: &usize| robot.root_coords() + link - 1;
            leg.links.iter().for_each(|link| tried[at(link)] = drawn[at(link)]);
            kinematics(robot, &tried, &mut data);
            -up.dot(&leg.way(&data))
        };
        leg.reach = (0..REACH_POSES).map(drop).fold(0.0, f64::max);
    }
    legs.retain(|leg| leg.reach > 0.0);
    kinematics(robot, state, &mut data);
    // A leg bends in the plane normal to its knee axis; along the axis the foot keeps its position.
    let across = |link: &usize| {
        let axis = data.rotation[*link] * joint(link)?.axis().into_inner();
        (axis - up * up.dot(&axis)).try_normalize(0.5)
    };
    let knee = |leg: &Leg| leg.links.iter().filter(apart).find_map(across);
    let usual = legs.iter().find_map(knee).unwrap_or_else(|| data.rotation[0] * Vector3::y());
    let ways: Vec<[Vector3<f64>; 2]> = legs
        .iter()
        .map(|leg| {
            let way = leg.way(&data);
            let along = knee(leg).unwrap_or(usual);
            [way, along * along.dot(&way)]
        })
        .collect();
    let hips: Vec<f64> = legs.iter().map(|leg| up.dot(&(data.origin + data.position[leg.links[0]]))).collect();
    let lows = hips.iter().zip(&ways).map(|(hip, [way, _])| hip + up.dot(way));
    let uneven = lows.clone().fold(f64::MIN, f64::max) - lows.fold(f64::MAX, f64::min);
    let below = |way: &Vector3<f64>, beside: &Vector3<f64>| (way - beside - up * up.dot(way)).norm();
    if legs.iter().zip(&ways).all(|(leg, [way, beside])| {
        below(way, beside) < MAX_FOOT_ERROR * leg.reach && uneven < MAX_FOOT_HEIGHT_DIFFERENCE * leg.reach
    }) {
        return false;
    }
    // All feet stand on one level, the highest that any leg requires.
    let ground = legs.iter().zip(&hips).map(|(leg, hip)| hip - HIP_HEIGHT_SHARE * leg.reach).fold(f64::MIN, f64::max);
    let mut each = legs.iter().zip(hips).zip(ways);
    each.all(|((leg, hip), [_, beside])| {
        leg.put(robot, state, &(beside + up * (ground - hip)), up) < MAX_FOOT_ERROR * leg.reach
    })
}
