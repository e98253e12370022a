//! Represents many contact points by a few.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, UnitVector3};
use nerd_core::contact::across;

use crate::internal::*;
use crate::robots::mesh::hull::{SUPPORT_DIRECTIONS, allowance, around, bounds, few};

/// Indices of at most `most` points. First come the extreme points toward the corners of the bounding box, lower ones
/// first. Then follow further points, each the farthest from all points chosen before. A sole with an ankle thus keeps
/// the corners of the sole. With `most` below four, the corners are skipped.
pub(crate) fn spread(points: &[Vector3<f64>], most: usize) -> Vec<usize> {
    let Some([least, largest]) = bounds(points) else { return Vec::new() };
    // Coordinates are scaled by the box's edges, so that a flat box also has eight corners.
    let unit = (largest - least).map(|x| if x > 0.0 { 1.0 / x } else { 0.0 });
    let mut taken: Vec<usize> = Vec::new();
    let mut away = vec![f64::INFINITY; points.len()];
    let mut take = |k: usize, taken: &mut Vec<usize>| {
        away.iter_mut().zip(points).for_each(|(d, p)| *d = d.min((p - points[k]).norm()));
        taken.push(k);
        away.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, far)| *far > 1e-6)
    };
    let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let outer = (0..points.len()).max_by(|a, b| (points[*a] - middle).norm().total_cmp(&(points[*b] - middle).norm()));
    let mut next = outer.map(|k| (k, 0.0));
    for corner in if most < 4 { 0..0 } else { 0..8 } {
        let towards =
            Vector3::new(0, 1, 2).map(|axis| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 }).component_mul(&unit);
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

/// Contact radius (m) of a corner, edge or vertex.
pub(crate) const SHARP_RADIUS: f64 = 1e-5;
/// Maximum numbers of contact points, which are inputs of a network: on a trunk (`TRUNK`), on a leaf link (`END`), on
/// any other link (`OTHER`). A leaf link stands on the lower corners of its box and may fall on its other end.
const TRUNK: usize = 8;
const END: usize = 5;
const OTHER: usize = 2;
/// Maximum number of rim points on links other than wheels. With more, the rims of cylinders are replaced by corners.
const MAX_ROLLING_POINTS: usize = 12;
/// A hinge with a range above this (rad) counts as endless, not as a hinge of a limb.
const MAX_LIMB_RANGE: f64 = 2.0 * TAU;
/// Number of directions for measuring a link's loss of support.
const LOSS_DIRECTIONS: usize = 3000;

/// Whether a joint rotates without end, like a wheel.
pub(crate) fn endless(joint: &Joint) -> bool {
    joint.kind != JointKind::Prismatic && joint.limit.is_none_or(|limit| limit.upper - limit.lower > MAX_LIMB_RANGE)
}

/// At most `most` contact points with the same support as spheres of `radius` (m) about all `places` on a link. Up to
/// `most` places become one point each. More places are divided into clusters, each with its deepest place as contact
/// point. `seen` are the places in axes with the third axis up.
pub(crate) fn partition(
    link: usize,
    places: &[Vector3<f64>],
    seen: &[Vector3<f64>],
    radius: f64,
    most: usize,
) -> Vec<ContactPoint> {
    if places.len() <= most {
        return places.iter().map(|place| ContactPoint::new(link, *place, radius)).collect();
    }
    let seeds = spread(seen, most);
    let mut shares = vec![Vec::new(); seeds.len()];
    for (place, seen_at) in places.iter().zip(seen) {
        let far = |k: &usize| (seen[seeds[*k]] - seen_at).norm_squared();
        if let Some(nearest) = (0..seeds.len()).min_by(|a, b| far(a).total_cmp(&far(b))) {
            shares[nearest].push(*place);
        }
    }
    let share = |share: Vec<Vector3<f64>>| match share[..] {
        [one] => ContactPoint::new(link, one, radius),
        _ => ContactPoint::hull(link, share, radius),
    };
    shares.into_iter().map(share).collect()
}

/// Support function of contact points along a unit vector in their link's frame (m).
pub(crate) fn reach<'a>(points: impl IntoIterator<Item = &'a ContactPoint>, n: &Vector3<f64>) -> f64 {
    let far = |p: &ContactPoint| n.dot(&p.deepest(&Matrix3::identity(), &-n)) + p.radius;
    points.into_iter().map(far).fold(f64::NEG_INFINITY, f64::max)
}

/// Replaces many contact points by a few, since each is an input of the network. Also returns for each link the
/// additional penetration (m) that the fewer points allow. Corners and vertices become a few points, each the deepest
/// of its cluster, so that no possible lowest point is lost. Round shapes stay round, unless other shapes of the link
/// reach as far in every direction. Points on the lower corners at `state` get separate clusters.
pub(crate) fn enough(robot: &Robot, state: &[f64]) -> (Vec<ContactPoint>, Vec<f64>) {
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let turns = |link: usize| robot.links[link].joint.as_ref().is_some_and(endless);
    let is_rim = |p: &ContactPoint| matches!(p.locus, Locus::Rim { .. });
    let few_rims = robot.contact_points.iter().filter(|p| is_rim(p) && !turns(p.link)).count() <= MAX_ROLLING_POINTS;
    let on = |link: usize| robot.contact_points.iter().filter(move |p| p.link == link);
    let of = |link: usize, surface: Option<usize>| {
        let own: Vec<&ContactPoint> = on(link).filter(|p| p.surface == surface).collect();
        let round_ones = few_rims || turns(link);
        let wheel = turns(link) && on(link).any(is_rim);
        let end = robot.links.iter().all(|other| other.parent != Some(link)) && !wheel;
        let most = if link == 0 && robot.floating() {
            TRUNK
        } else if end {
            END
        } else {
            OTHER
        };
        let mut sharp = Vec::new();
        let mut round = Vec::<Vec<ContactPoint>>::new();
        for &p in &own {
            match (&p.locus, round.last_mut()) {
                (Locus::Rim { axis, radius, turn }, _) if !round_ones => {
                    sharp.extend(polygon(&p.local, axis, *radius).filter(|_| *turn == 0.0));
                }
                (Locus::Rim { turn, .. }, Some(disc)) if *turn != 0.0 => disc.push(p.clone()),
                (Locus::Fixed | Locus::Hull { .. }, _) if p.radius <= SHARP_RADIUS => sharp.extend(p.places()),
                _ => round.push(vec![p.clone()]),
            }
        }
        let places: Vec<_> = own.iter().flat_map(|p| p.places()).collect();
        let off = allowance(&places);
        let corners = (!sharp.is_empty()).then(|| ContactPoint::hull(link, sharp.clone(), SHARP_RADIUS));
        // The smallest shapes are removed first.
        round.sort_by(|a, b| (a[0].radius + a[0].reach()).total_cmp(&(b[0].radius + b[0].reach())));
        shown(&mut round, &corners, off);
        let (balls, rims): (Vec<_>, Vec<_>) = round.into_iter().flatten().partition(|p| p.locus == Locus::Fixed);
        let vertices = few(&sharp, |n| reach(balls.iter().chain(&rims), n), off);
        let mut radii: Vec<(f64, Vec<Vector3<f64>>)> = vec![(SHARP_RADIUS, vertices)];
        for ball in balls {
            match radii.iter_mut().skip(1).find(|(radius, _)| *radius == ball.radius) {
                Some((_, places)) => places.push(ball.local),
                None => radii.push((ball.radius, vec![ball.local])),
            }
        }
        let share = |(radius, places): (f64, Vec<Vector3<f64>>)| {
            let seen: Vec<_> = places.iter().map(|place| data.rotation[link] * place).collect();
            partition(link, &places, &seen, radius, most)
        };
        radii.into_iter().flat_map(share).chain(rims).map(|point| point.on(surface)).collect::<Vec<_>>()
    };
    let of = |link: usize| {
        let surfaces: BTreeSet<_> = on(link).map(|p| p.surface).collect();
        let kept: Vec<ContactPoint> = surfaces.into_iter().flat_map(|surface| of(link, surface)).collect();
        let loss = around(LOSS_DIRECTIONS).map(|n| reach(on(link), &n) - reach(&kept, &n)).fold(0.0, f64::max);
        (kept, loss)
    };
    let (kept, losses): (Vec<_>, _) = (0..robot.links.len()).map(of).unzip();
    (kept.concat(), losses)
}

/// Removes, one after the other, shapes that reach at most `off` (m) beyond all others in every direction.
fn shown(round: &mut Vec<Vec<ContactPoint>>, corners: &Option<ContactPoint>, off: f64) {
    let directions: Vec<Vector3<f64>> = around(SUPPORT_DIRECTIONS).collect();
    let further = |far: &mut Vec<f64>, disc: &[ContactPoint]| {
        far.iter_mut().zip(&directions).for_each(|(far, n)| *far = far.max(reach(disc, n)))
    };
    // `behind`: support (m) of the shapes after each shape; `before`: of the kept shapes before it.
    let mut behind = vec![vec![f64::NEG_INFINITY; directions.len()]];
    for disc in round.iter().skip(1).rev() {
        let mut far = behind[behind.len() - 1].clone();
        further(&mut far, disc);
        behind.push(far);
    }
    let mut before: Vec<f64> = directions.iter().map(|n| reach(corners, n)).collect();
    round.retain(|disc| {
        let behind = behind.pop().unwrap_or_default();
        let hides = |k: usize| behind[k].max(before[k]) + off;
        let hidden = directions.iter().enumerate().all(|(k, n)| reach(disc, n) <= hides(k));
        if !hidden {
            further(&mut before, disc);
        }
        !hidden
    });
}

/// Vertices around a disc's rim, deviating from the rim by at most half the allowance.
fn polygon(centre: &Vector3<f64>, axis: &UnitVector3<f64>, radius: f64) -> impl Iterator<Item = Vector3<f64>> {
    let up = across(axis) * radius;
    let off = 0.5 * allowance(&[up, -up]);
    let count = if off > 0.0 { (PI / (1.0 - off / radius).acos()).ceil() as usize } else { 1 };
    (0..count).map(move |k| centre + Rotation3::from_axis_angle(axis, TAU * k as f64 / count as f64) * up)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_sole_are_its_corners() {
        // Points all over a box of 0.2 x 0.1 x 0.02 m.
        let steps = |n: i32| (0..=n).map(move |k| f64::from(k) / f64::from(n) - 0.5);
        let all: Vec<Vector3<f64>> = steps(8)
            .flat_map(|x| steps(8).flat_map(move |y| steps(2).map(move |z| Vector3::new(0.2 * x, 0.1 * y, 0.02 * z))))
            .collect();
        let found = spread(&all, 8);
        assert_eq!(found.len(), 8);
        for p in found.iter().map(|k| all[*k]) {
            let off = (p.abs() - Vector3::new(0.1, 0.05, 0.01)).amax();
            assert!(off < 1e-9, "{p} is {off:.1e} m from a corner");
        }
        // The lower four come first; coincident points give a single one.
        assert!(spread(&all, 4).iter().all(|k| all[*k].z < 0.0));
        assert_eq!(spread(&[Vector3::x(); 5], 8).len(), 1);
    }
}
