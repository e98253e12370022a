//! Limbs of a robot at a pose: the lowest point of each link's subtree.

use crate::{internal::*, scene::foot};

/// Least distance that legs reach below all other links, as a share of the robot's height. The same share of the
/// longest limb is the least length of a leg, as opposed to a toe.
const MIN_LEG_SHARE: f64 = 0.2;
/// Largest height of a leg's end above the lowest point, as a share of the longest limb.
const MAX_LEG_END_HEIGHT: f64 = 0.3;

/// Heights (m) along the up axis, and subtrees of the links, `[link]`.
pub(super) struct Limbs {
    /// Height of the link's joint.
    origin: Vec<f64>,
    /// Height of the link's lowest point, of its shapes and its joint; for a root without shapes, of its origin.
    own: Vec<f64>,
    /// Height of the lowest point of the link's subtree.
    lowest: Vec<f64>,
    /// End (exclusive) of the link's subtree; its links are consecutive.
    end: Vec<usize>,
    /// Child links.
    below: Vec<Vec<usize>>,
}

impl Limbs {
    pub(super) fn new(robot: &Robot, state: &[f64], up: &Vector3<f64>) -> Self {
        let mut data = Data::new(robot);
        let n = robot.links.len();
        kinematics(robot, state, &mut data);
        let mut own = vec![f64::INFINITY; n];
        for p in &robot.contact_points {
            own[p.link] = own[p.link].min(foot(p, &data, up));
        }
        let origin: Vec<f64> = (0..n).map(|link| (data.origin + data.position[link]).dot(up)).collect();
        for link in usize::from(own[0].is_finite())..n {
            own[link] = own[link].min(origin[link]);
        }
        let mut lowest = own.clone();
        let mut end = (1..=n).collect::<Vec<_>>();
        let mut below = vec![Vec::new(); n];
        for link in (1..n).rev() {
            if let Some(parent) = robot.links[link].parent {
                lowest[parent] = lowest[parent].min(lowest[link]);
                end[parent] = end[parent].max(end[link]);
                below[parent].push(link);
            }
        }
        below.iter_mut().for_each(|links| links.reverse());
        Self { origin, own, lowest, end, below }
    }

    /// Indices of the link and its subtree.
    pub(super) fn all(&self, link: usize) -> std::ops::Range<usize> {
        link..self.end[link]
    }

    /// Whether two or more limbs that branch off from the root reach lower than all other links. The limbs may also
    /// branch off from another link, such as a pelvis, if they reach lower by the length of a leg.
    pub(super) fn walks(&self) -> bool {
        let n = self.own.len();
        let height = self.origin.iter().copied().fold(f64::MIN, f64::max) - self.lowest[0];
        let legs = |body: usize, longer: f64| {
            if self.below[body].len() < 2 {
                return 0;
            }
            let rest = (0..=body).chain(self.end[body]..n).map(|link| self.own[link]).fold(f64::INFINITY, f64::min);
            self.below[body].iter().filter(|link| self.lowest[**link] < rest - longer).count()
        };
        legs(0, 1e-6) >= 2 || (1..n).any(|body| legs(body, MIN_LEG_SHARE * height) >= 2)
    }

    /// First links of the legs: limbs that reach the ground and branch off in twos or more, from the root or below a
    /// waist. Front and hind legs may branch off from two links. For a one-legged robot, the link on the root.
    pub(super) fn hips(&self) -> Vec<usize> {
        let length = |link: usize| self.origin[link] - self.lowest[link];
        let longest = (1..self.own.len()).map(length).fold(0.0, f64::max);
        let bears = |link: &usize| {
            length(*link) > MIN_LEG_SHARE * longest
                && self.lowest[*link] < self.lowest[0] + MAX_LEG_END_HEIGHT * longest
        };
        let limbs = |body: usize| self.below[body].iter().copied().filter(bears).collect::<Vec<_>>();
        let mut hips: Vec<Vec<usize>> = vec![Vec::new(); self.own.len()];
        for body in (0..hips.len()).rev() {
            let limbs = limbs(body);
            let alone = limbs.len() < 2;
            for limb in limbs {
                let further = std::mem::take(&mut hips[limb]);
                hips[body].extend(if further.is_empty() && !alone { vec![limb] } else { further });
            }
        }
        let found = hips.swap_remove(0);
        if found.is_empty() { limbs(0) } else { found }
    }
}
