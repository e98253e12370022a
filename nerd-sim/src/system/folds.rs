//! Self-collision: pairs of links that may touch each other, with their contact laws (`self_collision`).
//!
//! Two kinds of pairs are excluded. First, a link and its nearest ancestor with shapes. Second, links that touch in the
//! default pose, since their shapes overlap by design. Where a robot's file lists the geoms that collide, this list
//! replaces the first rule.

use std::ops::Range;

use nerd_core::robot::Hull;

use super::capsules::{Capsule, rounded};
use crate::internal::*;
use crate::scene::{PairLaw, Surfaces};

/// Distance (m) below which parts in the default pose count as touching.
const MAX_TOUCHING_DISTANCE: f64 = 1e-3;

/// The parts of a robot that may touch each other; empty by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Folds {
    pub(crate) capsules: Vec<Capsule>,
    /// Link of each part: a part is a link, or the geoms of a link that share a surface of the file.
    pub(crate) links: Vec<usize>,
    /// For each part, the range of its capsules in `capsules`.
    pub(crate) own: Vec<Range<usize>>,
    /// Bounding sphere of each part: centre (m, link frame) and radius (m).
    pub(crate) balls: Vec<(Vector3<f64>, f64)>,
    /// Pairs of parts that are checked for collision.
    pub(crate) pairs: Vec<[usize; 2]>,
    /// For each of `pairs`, its contact law in the robot's file, if the file has one.
    pub(crate) laws: Vec<Option<PairLaw>>,
}

impl Folds {
    /// Finds the pairs of parts that may collide, except pairs that touch in pose `q`. Also returns a note that counts
    /// the pairs and lists the links that touch.
    pub(crate) fn new(robot: &Robot, meshes: &[Hull], surfaces: &Surfaces, q: &[f64]) -> (Self, String) {
        let mut folds = Self::default();
        let mut of_file = Vec::new();
        let mut off = 0.0f64;
        for (link, surface) in (0..robot.links.len())
            .flat_map(|link| parts(robot, meshes, surfaces, link).into_iter().map(move |s| (link, s)))
        {
            let first = folds.capsules.len();
            let (mine, points) = of(robot, meshes, link, surface);
            off = off.max(if mine.is_empty() { 0.0 } else { rounded(&points, &mine) });
            folds.capsules.extend(mine);
            folds.own.push(first..folds.capsules.len());
            folds.links.push(link);
            of_file.push(surface);
        }
        folds.balls = folds.own.iter().map(|own| ball(&folds.capsules[own.clone()])).collect();
        let mut data = Data::new(robot);
        kinematics(robot, q, &mut data);
        let solid: Vec<usize> = (0..folds.own.len()).filter(|i| !folds.own[*i].is_empty()).collect();
        let bodied = |link: usize| solid.iter().any(|i| folds.links[*i] == link);
        let above = |i: usize| robot.ancestors(i).skip(1).find(|p| bodied(*p));
        // `None`: parts a and b never collide.
        let law = |[a, b]: [usize; 2]| match (of_file[a], of_file[b]) {
            (Some(a), Some(b)) => surfaces.between(a, b).copied().map(Some),
            _ => (folds.links[a] != folds.links[b] && above(folds.links[b]) != Some(folds.links[a])).then_some(None),
        };
        let pairs = solid.iter().flat_map(|b| solid.iter().take_while(move |a| *a < b).map(move |a| [*a, *b]));
        let apart = pairs.filter_map(|pair| Some((pair, law(pair)?)));
        let (touch, pairs): (Vec<_>, Vec<_>) =
            apart.partition(|(pair, _)| folds.gap(pair, &data) < MAX_TOUCHING_DISTANCE);
        let mut touch: Vec<_> = touch.iter().map(|(pair, _)| pair.map(|part| folds.links[part])).collect();
        touch.dedup();
        (folds.pairs, folds.laws) = pairs.into_iter().unzip();
        let named = touch
            .iter()
            .map(|[a, b]| format!("{} - {}", robot.links[*a].name, robot.links[*b].name))
            .collect::<Vec<_>>();
        let without = if named.is_empty() {
            String::new()
        } else {
            format!("; not of those that touch in the default pose: {}", named.join(", "))
        };
        let mut met: Vec<_> = folds.pairs.iter().map(|pair| pair.map(|part| folds.links[part])).collect();
        met.dedup();
        let note = match met.len() {
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

    /// The capsules of a part, moved to the axes in which `data` holds the link poses.
    #[inline]
    pub(crate) fn placed<'a>(&'a self, part: usize, data: &'a Data) -> impl Iterator<Item = Capsule> + Clone + 'a {
        let link = self.links[part];
        self.capsules[self.own[part].clone()].iter().map(move |c| c.moved(&data.rotation[link], &data.position[link]))
    }

    /// Distance (m) between two parts, negative if they overlap.
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

/// The surface of each part of a link, limited to surfaces that may collide with another link. Without surfaces in the
/// robot's file, a link is one part (`None`).
fn parts(robot: &Robot, meshes: &[Hull], surfaces: &Surfaces, link: usize) -> Vec<Option<usize>> {
    if surfaces.is_empty() {
        return vec![None];
    }
    let of = |link: usize| {
        let hulls = meshes.iter().filter(move |mesh| mesh.link == link).map(|mesh| mesh.surface);
        robot.links[link].shapes.iter().map(|shape| shape.surface).chain(hulls)
    };
    let mut own: Vec<_> = of(link).collect();
    own.sort_unstable();
    own.dedup();
    let meets = |own: usize| {
        (0..robot.links.len())
            .filter(|other| *other != link)
            .flat_map(of)
            .any(|o| o.is_none_or(|o| surfaces.between(own, o).is_some()))
    };
    own.retain(|own| own.is_none_or(meets));
    own
}

/// Capsules of a part, from its shapes and meshes, else from convex hulls among its contact points. Also returns the
/// points that the capsules should cover.
fn of(robot: &Robot, meshes: &[Hull], link: usize, surface: Option<usize>) -> (Vec<Capsule>, Vec<ContactPoint>) {
    let shapes = || robot.links[link].shapes.iter().filter(|shape| surface.is_none() || shape.surface == surface);
    let mut capsules: Vec<_> = shapes().flat_map(Capsule::of_shape).collect();
    let mut points: Vec<_> = shapes().flat_map(|shape| shape.contact_points(link)).collect();
    let own = |mesh: &&Hull| mesh.link == link && (surface.is_none() || mesh.surface == surface);
    let meshes = meshes.iter().filter(own).map(|mesh| &mesh.vertices);
    let hulls =
        robot.contact_points.iter().filter(|p| p.link == link && surface.is_none()).filter_map(|p| match &p.locus {
            Locus::Hull { vertices, .. } => Some(vertices),
            _ => None,
        });
    let meshes: Vec<_> =
        if shapes().next().is_none() && meshes.clone().next().is_none() { hulls.collect() } else { meshes.collect() };
    for vertices in meshes {
        capsules.extend(Capsule::of_hull(vertices));
        points.push(ContactPoint::hull(link, vertices.clone(), 0.0));
    }
    // A capsule inside another is redundant.
    let needless = |k: &usize| {
        (0..capsules.len())
            .any(|o| o != *k && capsules[*k].within(&capsules[o]) && (o < *k || !capsules[o].within(&capsules[*k])))
    };
    let kept = (0..capsules.len()).filter(|k| !needless(k)).map(|k| capsules[k]).collect();
    (kept, points)
}

/// A bounding sphere of capsules, not the smallest one: centre (m) and radius (m).
fn ball(capsules: &[Capsule]) -> (Vector3<f64>, f64) {
    let centre = capsules.iter().map(|c| c.middle).sum::<Vector3<f64>>() / capsules.len().max(1) as f64;
    let far = |c: &Capsule| (c.middle - centre).norm() + c.half.norm() + c.radius;
    (centre, capsules.iter().map(far).fold(0.0, f64::max))
}
