//! Which links of a robot may touch each other, and with what (`self_collision`).
//!
//! Left out are a link with the one that it hangs on, where links without shapes do not count, and what touches in the default pose: there
//! shapes of a file overlap by design.

use std::ops::Range;

use nerd_core::robot::Hull;

use super::capsules::{Capsule, rounded};
use crate::internal::*;

/// What is nearer than this in the default pose touches there (m).
const TOUCHING: f64 = 1e-3;

/// What of a robot may touch itself. Nothing, by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Folds {
    pub(crate) capsules: Vec<Capsule>,
    /// By link, which of them are its own.
    pub(crate) own: Vec<Range<usize>>,
    /// By link, centre (m, link frame) and radius (m) of a ball about them.
    pub(crate) balls: Vec<(Vector3<f64>, f64)>,
    pub(crate) pairs: Vec<[usize; 2]>,
}

impl Folds {
    /// Those of a robot with these meshes, in a pose in which what touches is left out; and a line about it.
    pub(crate) fn new(robot: &Robot, meshes: &[Hull], q: &[f64]) -> (Self, String) {
        let (mut capsules, mut own, mut off) = (Vec::new(), Vec::new(), 0.0f64);
        for link in 0..robot.links.len() {
            let first = capsules.len();
            let (mine, points) = of(robot, meshes, link);
            off = off.max(if mine.is_empty() { 0.0 } else { rounded(&points, &mine) });
            capsules.extend(mine);
            own.push(first..capsules.len());
        }
        let balls = own.iter().map(|own| ball(&capsules[own.clone()])).collect();
        let mut folds = Self { capsules, own, balls, pairs: Vec::new() };
        let mut data = Data::new(robot);
        kinematics(robot, q, &mut data);
        let solid: Vec<usize> = (0..robot.links.len()).filter(|i| !folds.own[*i].is_empty()).collect();
        let above = |i: usize| std::iter::successors(robot.links[i].parent, |p| robot.links[*p].parent).find(|p| !folds.own[*p].is_empty());
        let pairs = solid.iter().flat_map(|b| solid.iter().take_while(move |a| *a < b).map(move |a| [*a, *b]));
        let apart = pairs.filter(|[a, b]| above(*b) != Some(*a));
        let (touch, pairs): (Vec<_>, Vec<_>) = apart.partition(|pair| folds.gap(pair, &data) < TOUCHING);
        folds.pairs = pairs;
        let named = touch.iter().map(|[a, b]| format!("{} - {}", robot.links[*a].name, robot.links[*b].name)).collect::<Vec<_>>();
        let without =
            if named.is_empty() { String::new() } else { format!("; not of those that touch in the default pose: {}", named.join(", ")) };
        let note = match folds.pairs.len() {
            0 => format!("self_collision: it has no two links that could touch{without}"),
            n => format!(
                "self_collision of {n} pairs of links, as {} capsules, beyond which corners go by {:.1} mm at most{without}",
                folds.capsules.len(),
                1e3 * off
            ),
        };
        (folds, note)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// The capsules of a link, in the axes of `data`.
    #[inline]
    pub(crate) fn placed<'a>(&'a self, link: usize, data: &'a Data) -> impl Iterator<Item = Capsule> + Clone + 'a {
        self.capsules[self.own[link].clone()].iter().map(move |c| c.moved(&data.rotation[link], &data.position[link]))
    }

    /// How far two links are apart (m).
    fn gap(&self, [a, b]: &[usize; 2], data: &Data) -> f64 {
        let gaps = self.placed(*a, data).flat_map(|one| self.placed(*b, data).map(move |other| one.meets(&other).gap));
        gaps.fold(f64::INFINITY, f64::min)
    }

    #[cfg(feature = "calibrate")]
    pub(crate) fn scale(&mut self, factor: f64) {
        for c in &mut self.capsules {
            (c.middle, c.half, c.radius) = (c.middle * factor, c.half * factor, c.radius * factor);
        }
        for (centre, reach) in &mut self.balls {
            (*centre, *reach) = (*centre * factor, *reach * factor);
        }
    }
}

/// A link's capsules: of its shapes and meshes, or else of the hulls among its contact points; and what of it they should cover.
fn of(robot: &Robot, meshes: &[Hull], link: usize) -> (Vec<Capsule>, Vec<ContactPoint>) {
    let shapes = &robot.links[link].shapes;
    let mut capsules: Vec<_> = shapes.iter().flat_map(Capsule::of_shape).collect();
    let mut points: Vec<_> = shapes.iter().flat_map(|shape| shape.contact_points(link)).collect();
    let meshes = meshes.iter().filter(|mesh| mesh.link == link).map(|mesh| &mesh.vertices);
    let hulls = robot.contact_points.iter().filter(|p| p.link == link).filter_map(|p| match &p.locus {
        Locus::Hull { vertices, .. } => Some(vertices),
        _ => None,
    });
    let meshes: Vec<_> = if shapes.is_empty() && meshes.clone().next().is_none() { hulls.collect() } else { meshes.collect() };
    for vertices in meshes {
        capsules.extend(Capsule::of_hull(vertices));
        points.push(ContactPoint::hull(link, vertices.clone(), 0.0));
    }
    // A ball at the end of a capsule adds nothing to it.
    let needless = |k: &usize| {
        (0..capsules.len()).any(|o| o != *k && capsules[*k].within(&capsules[o]) && (o < *k || !capsules[o].within(&capsules[*k])))
    };
    let kept = (0..capsules.len()).filter(|k| !needless(k)).map(|k| capsules[k]).collect();
    (kept, points)
}

/// A ball about capsules, not the smallest.
fn ball(capsules: &[Capsule]) -> (Vector3<f64>, f64) {
    let centre = capsules.iter().map(|c| c.middle).sum::<Vector3<f64>>() / capsules.len().max(1) as f64;
    let far = |c: &Capsule| (c.middle - centre).norm() + c.half.norm() + c.radius;
    (centre, capsules.iter().map(far).fold(0.0, f64::max))
}
