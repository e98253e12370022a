//! Convex hulls, and few of their vertices that reach nearly as far in every direction.

use std::f64::consts::PI;

use nalgebra::Vector3;
use parry3d_f64::{math::Vector as ParryVector, transformation::try_convex_hull};

/// Directions, evenly all around, in which reach is compared, besides those of the vertices: some four degrees from each to the next.
pub(crate) const AROUND: usize = 2000;
/// Most vertices of a hull each of which is asked in its own direction.
const CLOSELY: usize = 4000;
/// How much less far (m) what is kept may reach than all did, and the share of its size (m/m) where that is less.
const OFF: [f64; 2] = [5e-4, 5e-3];

/// Unit vectors evenly all around: a spiral from pole to pole, a golden angle from one to the next.
pub(crate) fn around(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    (0..count).map(move |k| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let (sin, cos) = (PI * (3.0 - 5f64.sqrt()) * k as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * cos, r * sin, z)
    })
}

/// How much less far (m) what is kept of some points may reach than all of them do.
pub(crate) fn allowance(points: &[Vector3<f64>]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let [low, high] = points.iter().fold([*first; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
    OFF[0].min(OFF[1] * (high - low).amax())
}

/// Few of some points: together with what reaches `others(n)` along a unit vector n (m), they reach as far as all of them but for `off` (m).
pub(crate) fn few(points: &[Vector3<f64>], others: impl Fn(&Vector3<f64>) -> f64, off: f64) -> Vec<Vector3<f64>> {
    let (places, outward) = hull(points);
    // A vertex is missed most where it alone is the farthest.
    let own = outward.into_iter().enumerate().map(|(k, n)| (n, k)).step_by(places.len().div_ceil(CLOSELY).max(1));
    let asked = farthest(&places, around(AROUND)).chain(own);
    cover(&places, asked, others, off).into_iter().map(|k| places[k]).collect()
}

/// Directions, and which of some points is the farthest in each.
pub(crate) fn farthest(
    points: &[Vector3<f64>],
    directions: impl Iterator<Item = Vector3<f64>>,
) -> impl Iterator<Item = (Vector3<f64>, usize)> {
    directions.filter_map(|n| {
        let far = |k: &usize| n.dot(&points[*k]);
        Some((n, (0..points.len()).max_by(|a, b| far(a).total_cmp(&far(b)))?))
    })
}

/// The same by number, as asked in some directions with the point that is the farthest there: always the one that is missed most.
pub(crate) fn cover(
    points: &[Vector3<f64>],
    asked: impl Iterator<Item = (Vector3<f64>, usize)>,
    others: impl Fn(&Vector3<f64>) -> f64,
    off: f64,
) -> Vec<usize> {
    let mut asked: Vec<_> = asked.map(|(n, k)| (n, k, n.dot(&points[k]) - others(&n))).collect();
    let mut kept = Vec::new();
    while let Some((_, k, _)) = asked.iter().copied().max_by(|a, b| a.2.total_cmp(&b.2)).filter(|most| most.2 > off) {
        kept.push(k);
        asked.iter_mut().for_each(|(n, own, short)| *short = short.min(n.dot(&(points[*own] - points[k]))));
    }
    kept
}

pub(crate) type Surface = (Vec<Vector3<f64>>, Vec<[u32; 3]>);

/// The vertices of the convex hull and its triangles, seen from outside against the clock; none of points in a plane.
pub(crate) fn faces(points: &[Vector3<f64>]) -> Option<Surface> {
    let own: Vec<_> = points.iter().map(|v| ParryVector::new(v.x, v.y, v.z)).collect();
    let (corners, faces) = std::panic::catch_unwind(|| try_convex_hull(&own).ok()).ok().flatten()?;
    Some((corners.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect(), faces))
}

/// The vertices of the convex hull, and for each the direction in the midst of its faces; where there is none, since the points lie in a plane,
/// all of them and no direction.
pub(crate) fn hull(points: &[Vector3<f64>]) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
    let Some((corners, faces)) = faces(points) else { return (points.to_vec(), Vec::new()) };
    let mut outward = vec![Vector3::zeros(); corners.len()];
    for face in faces {
        let [a, b, c] = face.map(|k| corners[k as usize]);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
        face.iter().for_each(|k| outward[*k as usize] += normal);
    }
    outward.iter_mut().for_each(|n| *n = n.try_normalize(0.0).unwrap_or_default());
    (corners, outward)
}
