//! A leg of a robot, and inverse kinematics that place its foot.

use nalgebra::{Matrix6, Vector6};

use super::spread::endless;
use crate::internal::*;

/// Iterations of the inverse kinematics.
const ITERATIONS: usize = 200;
/// Shares of the largest distance of a contact point from the joint of its link. Points nearer to the joint than the
/// share `SHANK` belong to the shank. Other points belong to the sole if they are at most the share `SOLE` higher than
/// the farthest point.
const SHANK: f64 = 1.0 / 3.0;
const SOLE: f64 = 0.05;
/// Weight of a foot's orientation error (rad) relative to its position error in units of the leg's reach. The small
/// weight only determines joints that the position leaves undetermined.
const ORIENTATION_WEIGHT: f64 = 0.01;
/// Initial bend of a leg that may be straight (rad or m), toward the middle of its joints' ranges.
const INITIAL_BEND: f64 = 0.01;

/// A leg: its links from the hip to the foot.
pub(super) struct Leg {
    pub links: Vec<usize>,
    /// Centre of the sole or of a wheel, on the last link (m, link frame).
    sole: Vector3<f64>,
    /// Direction on the last link that points up; `None` for a wheel.
    level: Option<Vector3<f64>>,
    /// Largest distance of the foot below the hip (m).
    pub reach: f64,
}

impl Leg {
    /// The leg with links among `all`, starting with the hip; `None` without contact points. `data` has the kinematics
    /// with all joints at zero, where feet count as level.
    pub fn new(robot: &Robot, data: &Data, up: &Vector3<f64>, all: std::ops::Range<usize>) -> Option<Self> {
        let above =
            |link: usize| std::iter::successors(Some(link), |k| robot.links[*k].parent.filter(|_| *k != all.start));
        let length = |link: usize| {
            let chain: Vec<usize> = above(link).collect();
            chain.windows(2).map(|pair| (data.position[pair[0]] - data.position[pair[1]]).norm()).sum::<f64>()
        };
        let touching = robot.contact_points.iter().filter(|p| all.contains(&p.link));
        let places: Vec<(usize, Vector3<f64>)> =
            touching.flat_map(|p| p.places().into_iter().map(|at| (p.link, at))).collect();
        let far = |(link, at): &(usize, Vector3<f64>)| length(*link) + at.norm();
        let (last, end) = places.iter().max_by(|a, b| far(a).total_cmp(&far(b))).copied()?;
        let mut links: Vec<usize> = above(last).collect();
        links.reverse();
        // The centre of the sole's lower corners.
        let height = |at: &Vector3<f64>| up.dot(&point_position(data, last, at));
        let low = |at: &Vector3<f64>| at.norm() >= SHANK * end.norm() && height(at) <= height(&end) + SOLE * end.norm();
        let soles = places.into_iter().filter(|(link, at)| *link == last && low(at)).map(|(_, at)| at);
        let [least, most] = soles.fold([end; 2], |[a, b], at| [a.inf(&at), b.sup(&at)]);
        let middle = 0.5 * (least + most);
        let up = data.rotation[last].transpose() * up;
        let wheel =
            robot.links[last].joint.as_ref().filter(|joint| endless(joint)).map(|joint| joint.axis().into_inner());
        // A wheel may have any orientation.
        let (sole, level) = wheel.map_or((middle, Some(up)), |axis| (axis * axis.dot(&middle), None));
        Some(Self { links, sole, level, reach: 0.0 })
    }

    fn last(&self) -> usize {
        self.links[self.links.len() - 1]
    }

    /// Vector from hip to sole (m, world axes) in the pose whose kinematics `data` holds.
    pub fn way(&self, data: &Data) -> Vector3<f64> {
        point_position(data, self.last(), &self.sole) - (data.origin + data.position[self.links[0]])
    }

    /// Moves the joints until the sole is level and at `asked` from the hip (m, world axes). Returns the remaining
    /// distance (m).
    pub fn put(&self, robot: &Robot, state: &mut [f64], asked: &Vector3<f64>, up: &Vector3<f64>) -> f64 {
        let mut data = Data::new(robot);
        let at = |link: usize| robot.root_coords() + link - 1;
        let limit = |link: usize| robot.links[link].joint.as_ref().and_then(|joint| joint.limit);
        let within = |link: usize, q: f64| limit(link).map_or(q, |limit| q.clamp(limit.lower, limit.upper));
        // A straight leg is singular, so bend it slightly.
        let inside = |link: &usize| {
            limit(*link).is_none_or(|limit| limit.lower < state[at(*link)] && state[at(*link)] < limit.upper)
        };
        if self.links.iter().all(inside) {
            for (link, limit) in self.links.iter().filter_map(|link| Some((*link, limit(*link)?))) {
                state[at(link)] +=
                    (0.5 * (limit.lower + limit.upper) - state[at(link)]).clamp(-INITIAL_BEND, INITIAL_BEND);
            }
        }
        let rows = |way: &Vector3<f64>, level: &Vector3<f64>| {
            let way = way / self.reach;
            let level = if self.level.is_some() { level * ORIENTATION_WEIGHT } else { Vector3::zeros() };
            Vector6::new(way.x, way.y, way.z, level.x, level.y, level.z)
        };
        let mut seen = |state: &[f64]| {
            kinematics(robot, state, &mut data);
            (self.way(&data), rows(&self.way(&data), &(data.rotation[self.last()] * self.level.unwrap_or_default())))
        };
        for _ in 0..ITERATIONS {
            let (_, now) = seen(state);
            let mut square = Matrix6::identity() * 1e-7;
            let mut slopes = Vec::new();
            for link in &self.links {
                let mut moved = state.to_vec();
                moved[at(*link)] += 1e-6;
                let slope = (seen(&moved).1 - now) / 1e-6;
                square += slope * slope.transpose();
                slopes.push(slope);
            }
            let Some(push) = square.try_inverse().map(|inverse| inverse * (rows(asked, up) - now)) else { break };
            for (link, slope) in self.links.iter().zip(slopes) {
                let q = &mut state[at(*link)];
                *q = within(*link, *q + slope.dot(&push).clamp(-0.1, 0.1));
            }
        }
        // Round to 1e-3 rad: the result is an estimate.
        for link in &self.links {
            let q = &mut state[at(*link)];
            *q = within(*link, (*q * 1e3).round() / 1e3 + 0.0);
        }
        (seen(state).0 - asked).norm()
    }
}
