//! Convex hulls, and small subsets of their vertices with nearly the same support in every direction.

use std::f64::consts::PI;

use nalgebra::Vector3;
use parry3d_f64::{math::Vector as ParryVector, transformation::try_convex_hull};

/// Evenly spread directions in which support is compared, besides the vertices' own: about four degrees apart.
pub(crate) const AROUND: usize = 2000;
/// Most vertices of a hull whose own directions are compared, too.
const CLOSELY: usize = 4000;
/// Largest loss of support (m) of the kept vertices, and as a share of the size (m/m); the smaller one counts.
const OFF: [f64; 2] = [5e-4, 5e-3];

/// Share of that allowance by which a mesh's hull may differ from its file.
const FINE: f64 = 0.2;

/// Unit vectors evenly spread over the sphere: a spiral from pole to pole, a golden angle from one to the next.
pub(crate) fn around(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    (0..count).map(move |k| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let (sin, cos) = (PI * (3.0 - 5f64.sqrt()) * k as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * cos, r * sin, z)
    })
}

/// Largest loss of support (m) of a subset of these points.
pub(crate) fn allowance(points: &[Vector3<f64>]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let [low, high] = points.iter().fold([*first; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
    OFF[0].min(OFF[1] * (high - low).amax())
}

/// A subset of points: together with a support of `others(n)` along a unit vector n (m), they reach as far as all points within `off` (m).
pub(crate) fn few(points: &[Vector3<f64>], others: impl Fn(&Vector3<f64>) -> f64, off: f64) -> Vec<Vector3<f64>> {
    let (places, outward) = hull(points);
    // The loss of a vertex is largest in the direction where it alone is the farthest.
    let own = outward.into_iter().enumerate().map(|(k, n)| (n, k)).step_by(places.len().div_ceil(CLOSELY).max(1));
    let asked = farthest(&places, around(AROUND)).chain(own);
    cover(&places, asked, others, off).into_iter().map(|k| places[k]).collect()
}

/// A subset of a mesh's vertices, whose hull differs from the file's by at most [`FINE`] of the allowance.
pub(crate) fn corners(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    few(points, |_| f64::NEG_INFINITY, FINE * allowance(points))
}

/// Directions, and the farthest point in each.
pub(crate) fn farthest(
    points: &[Vector3<f64>],
    directions: impl Iterator<Item = Vector3<f64>>,
) -> impl Iterator<Item = (Vector3<f64>, usize)> {
    directions.filter_map(|n| {
        let far = |k: &usize| n.dot(&points[*k]);
        Some((n, (0..points.len()).max_by(|a, b| far(a).total_cmp(&far(b)))?))
    })
}

/// The same as indices, for given directions and their farthest points: always adds the point with the largest loss.
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

/// The vertices of the convex hull and its triangles, counter-clockwise from outside; `None` for points in a plane.
pub(crate) fn faces(points: &[Vector3<f64>]) -> Option<Surface> {
    let own: Vec<_> = points.iter().map(|v| ParryVector::new(v.x, v.y, v.z)).collect();
    let (corners, faces) = std::panic::catch_unwind(|| try_convex_hull(&own).ok()).ok().flatten()?;
    Some((corners.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect(), faces))
}

/// The vertices of the convex hull, and for each the mean direction of its faces; for points in a plane all of them, without directions.
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
