//! Selects the shapes of a fixed base that its robot can touch like a scene.

use super::limits::pose;
use crate::internal::*;

/// Distance (m) from a contact point to the base, in any tested pose, below which the point counts as mounted on the
/// base.
const MAX_MOUNT_DISTANCE: f64 = 1e-3;
/// Number of random poses for testing the links on the base, in addition to the first pose.
const RANDOM_POSES: usize = 16;

/// Selects the shapes of the base that a robot can touch. Contact points of links joined to the base are removed if
/// they touch the base in some pose, since they are mounted there. A base shape that encloses other links at `state` is
/// left out, with a note.
pub(crate) fn settle(robot: &mut Robot, shapes: Vec<Shape>, state: &[f64], notes: &mut Vec<String>) -> Vec<Shape> {
    let Base::Fixed(at) = robot.base else { return Vec::new() };
    if shapes.is_empty() {
        return shapes;
    }
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let mut kept = Vec::new();
    let mut solid = Vec::new();
    for shape in shapes {
        let collider = Collider::shaped(&shape, &at, Material::default());
        let deep = |p: &&ContactPoint| {
            let middle = point_position(&data, p.link, &p.local);
            robot.links[p.link].parent.is_some()
                && collider.meets(p, &data, &middle, f64::INFINITY).distance < p.radius - MAX_MOUNT_DISTANCE
        };
        match robot.contact_points.iter().find(deep) {
            Some(p) => notes.push(format!(
                "a shape of the base touches nothing, since `{}` is inside of it",
                robot.links[p.link].name
            )),
            None => {
                kept.push(shape);
                solid.push(collider);
            }
        }
    }
    let (mut own, others): (Vec<_>, Vec<_>) =
        std::mem::take(&mut robot.contact_points).into_iter().partition(|p| robot.links[p.link].parent.is_none());
    for k in 0..=RANDOM_POSES {
        if k > 0 {
            kinematics(robot, &pose(robot, k - 1), &mut data);
        }
        let touches = |p: &ContactPoint, place: &Vector3<f64>| {
            solid
                .iter()
                .any(|c| c.query(&point_position(&data, p.link, place)).distance < p.radius + MAX_MOUNT_DISTANCE)
        };
        own.retain_mut(|p| {
            let places = p.places();
            let left: Vec<_> = places.iter().filter(|place| !touches(p, place)).copied().collect();
            let all = left.len() == places.len();
            if !all && !left.is_empty() && matches!(p.locus, Locus::Hull { .. }) {
                *p = ContactPoint::hull(p.link, left, p.radius).on(p.surface);
                return true;
            }
            all
        });
    }
    own.extend(others);
    own.sort_by_key(|p| p.link);
    robot.contact_points = own;
    if !kept.is_empty() {
        notes.push(format!(
            "{} shapes of the fixed base are part of every scene but `free`; scene `base` is these alone",
            kept.len()
        ));
    }
    kept
}
