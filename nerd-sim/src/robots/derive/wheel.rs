//! Rims as contact points of wheels: meshes that rotate without end and are round about the joint's axis.

use std::f64::consts::TAU;

use nerd_core::contact::across;

use super::spread::{SHARP_RADIUS, partition, reach};
use crate::internal::*;
use crate::robots::mesh::hull::{allowance, cover, farthest, few};

/// Largest relative difference of a wheel's radius between directions.
const MAX_RADIUS_DIFFERENCE: f64 = 0.02;
/// Maximum number of rims of a wheel; fewer are used if they reach as far within twice the allowance.
/// `MAX_OTHER_POINTS`: maximum number of a wheel's other points.
const MAX_RIMS: usize = 4;
const MAX_OTHER_POINTS: usize = 2;
/// Largest angle (rad) between a rolling wheel's support direction and its plane.
const MAX_CAMBER: f64 = 0.9;
/// Number of directions in the wheel's plane for comparing its radius.
const PLANE_DIRECTIONS: u32 = 32;
/// Number of directions for comparing rims with the profile.
const PROFILE_DIRECTIONS: u32 = 256;

/// Contact points of link `link`, which `joint` rotates: rims, plus points that reach beyond them in directions in
/// which the wheel does not roll. `None` if the points are not round about the joint's axis.
pub(crate) fn wheel(link: usize, joint: &Joint, points: &[Vector3<f64>]) -> Option<Vec<ContactPoint>> {
    let axis = joint.axis();
    let up = across(axis);
    let around = |count: u32| (0..count).map(move |k| (TAU * f64::from(k) / f64::from(count)).sin_cos());
    let side = |(sin, cos): (f64, f64)| {
        let n = up * cos + axis.cross(&up) * sin;
        points.iter().map(|p| n.dot(p)).fold(f64::MIN, f64::max)
    };
    let [low, high] =
        around(PLANE_DIRECTIONS).map(side).fold([f64::MAX, f64::MIN], |[low, high], x| [low.min(x), high.max(x)]);
    if !(high > 0.0 && high - low <= MAX_RADIUS_DIFFERENCE * high) {
        return None;
    }
    // Profile in the plane of axis and radius, with the mean of the radii at vertices and at edges. The largest radius
    // comes first.
    let mean = 0.5 * (low + high) / high;
    let profile: Vec<_> = points.iter().map(|p| Vector3::new(axis.dot(p), mean * axis.cross(p).norm(), 0.0)).collect();
    let outward = around(PROFILE_DIRECTIONS)
        .filter(|(sin, cos)| *cos > MAX_CAMBER.cos() && *sin != 0.0)
        .map(|(sin, cos)| Vector3::new(sin, cos, 0.0));
    let asked = farthest(&profile, outward.chain([Vector3::y()]));
    let kept = cover(&profile, asked, |_| f64::NEG_INFINITY, 2.0 * allowance(points));
    let rim = |k: usize| ContactPoint::disc(link, **axis * profile[k].x, *axis, profile[k].y, SHARP_RADIUS);
    let mut found: Vec<ContactPoint> = kept.into_iter().take(MAX_RIMS).flat_map(rim).collect();
    let beyond = few(points, |n| reach(&found, n), 2.0 * allowance(points) + 0.5 * (high - low));
    found.extend(partition(link, &beyond, &beyond, SHARP_RADIUS, MAX_OTHER_POINTS));
    Some(found)
}
