//! A few points that represent many.

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics};
use nerd_core::robot::Robot;

/// At most so many of the points, by number: those that lie farthest towards the corners of the box around them, the lower ones first, then
/// always the one farthest from all that were taken. A sole with an ankle on it keeps the corners that it stands on.
pub(crate) fn spread(points: &[Vector3<f64>], most: usize) -> Vec<usize> {
    let Some(first) = points.first() else { return Vec::new() };
    let (least, largest) = points.iter().fold((*first, *first), |(a, b), p| (a.inf(p), b.sup(p)));
    // In units of the box, so that a flat one has eight corners, too.
    let unit = (largest - least).map(|x| if x > 0.0 { 1.0 / x } else { 0.0 });
    let mut taken: Vec<usize> = Vec::new();
    let mut away = vec![f64::INFINITY; points.len()];
    let mut take = |k: usize, taken: &mut Vec<usize>| {
        away.iter_mut().zip(points).for_each(|(d, p)| *d = d.min((p - points[k]).norm()));
        taken.push(k);
        away.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, far)| *far > 1e-6)
    };
    let mut next = None;
    for corner in 0..8 {
        let towards = Vector3::new(0, 1, 2).map(|axis| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 }).component_mul(&unit);
        let far = |p: &Vector3<f64>| towards.dot(p);
        let Some(k) = (0..points.len()).max_by(|a, b| far(&points[*a]).total_cmp(&far(&points[*b]))) else { break };
        if taken.len() < most && taken.iter().all(|t| (points[*t] - points[k]).norm() > 1e-6) {
            next = take(k, &mut taken);
        }
    }
    while let Some((k, _)) = next.filter(|_| taken.len() < most) {
        next = take(k, &mut taken);
    }
    taken
}

/// Points of a trunk, of a link that nothing hangs on, and of any other that a network is shown.
const TRUNK: usize = 8;
const END: usize = 4;
const OTHER: usize = 2;
/// Of a wheel.
const WHEEL: usize = 24;
/// Lower share of a link that nothing hangs on, from which its points are taken: a shin touches with its foot.
const FOOT: f64 = 0.25;

/// Which contact points are enough to fall and stand on, by number and in order: every one is one more that a network sees. Of each link
/// those towards the corners of its box at `state`, the lower ones first; of one that nothing hangs on, of its lower end.
pub(crate) fn enough(robot: &Robot, state: &[f64]) -> Vec<usize> {
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let ends = |link: usize| robot.links.iter().all(|other| other.parent != Some(link));
    // The lowest place of a ball is what it stands on.
    let place = |k: &usize| {
        let point = &robot.contact_points[*k];
        crate::scene::place(point, &data, &Vector3::z()) - Vector3::z() * point.radius
    };
    let of = |link: usize| {
        let mut own: Vec<usize> = (0..robot.contact_points.len()).filter(|k| robot.contact_points[*k].link == link).collect();
        let trunk = link == 0 && robot.floating();
        let end = ends(link) && !trunk;
        // What turns without end may stand on any side of itself.
        let wheel = end && robot.links[link].joint.as_ref().is_some_and(|j| j.limit.is_none());
        if end && !wheel {
            let heights = own.iter().map(|k| place(k).z);
            let [low, high] = heights.fold([f64::INFINITY, -f64::INFINITY], |[a, b], z| [a.min(z), b.max(z)]);
            own.retain(|k| place(k).z <= low + FOOT * (high - low));
        }
        let places: Vec<Vector3<f64>> = own.iter().map(place).collect();
        let most = match (trunk, wheel, end) {
            (true, ..) => TRUNK,
            (_, true, _) => WHEEL,
            (.., true) => END,
            _ => OTHER,
        };
        spread(&places, most).into_iter().map(move |k| own[k]).collect::<Vec<_>>()
    };
    let mut taken: Vec<usize> = (0..robot.links.len()).flat_map(of).collect();
    taken.sort_unstable();
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_sole_are_its_corners() {
        // A box of 0.2 x 0.1 x 0.02 m with points all over it.
        let steps = |n: i32| (0..=n).map(move |k| f64::from(k) / f64::from(n) - 0.5);
        let all: Vec<Vector3<f64>> =
            steps(8).flat_map(|x| steps(8).flat_map(move |y| steps(2).map(move |z| Vector3::new(0.2 * x, 0.1 * y, 0.02 * z)))).collect();
        let found = spread(&all, 8);
        assert_eq!(found.len(), 8);
        for p in found.iter().map(|k| all[*k]) {
            let off = (p.abs() - Vector3::new(0.1, 0.05, 0.01)).amax();
            assert!(off < 1e-9, "{p} is {off:.1e} m from a corner");
        }
        // The lower four first; of a point there is one.
        assert!(spread(&all, 4).iter().all(|k| all[*k].z < 0.0));
        assert_eq!(spread(&[Vector3::x(); 5], 8).len(), 1);
    }
}
