//! Convex hulls, and small subsets of their vertices with nearly the same support in every direction.

use std::f64::consts::PI;

use nalgebra::Vector3;
use parry3d_f64::{math::Vector as ParryVector, transformation::try_convex_hull};

/// Number of evenly spread directions, about four degrees apart, in which support is compared. The normals at the
/// vertices are compared, too.
pub(crate) const SUPPORT_DIRECTIONS: usize = 2000;
/// Maximum number of vertices of a hull whose normals are compared.
const MAX_OWN_DIRECTIONS: usize = 4000;
/// Largest loss of support by dropping vertices: a length (m), and a share of the points' largest extent. The smaller
/// of the two is the allowance.
const MAX_SUPPORT_LOSS: [f64; 2] = [5e-4, 5e-3];

/// Largest loss of support of a mesh's reduced hull against all its vertices, as a share of the allowance.
const MAX_REDUCTION_SHARE: f64 = 0.2;

/// `count` unit vectors evenly spread over the sphere: a spiral from pole to pole in steps of the golden angle.
pub(crate) fn around(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    (0..count).map(move |k| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let (sin, cos) = (PI * (3.0 - 5f64.sqrt()) * k as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * cos, r * sin, z)
    })
}

/// Least and largest coordinates of points; `None` without points.
pub(crate) fn bounds(points: &[Vector3<f64>]) -> Option<[Vector3<f64>; 2]> {
    Some(points.iter().fold([*points.first()?; 2], |[low, high], p| [low.inf(p), high.sup(p)]))
}

/// Allowed loss of support (m) of a subset of these points.
pub(crate) fn allowance(points: &[Vector3<f64>]) -> f64 {
    let Some([low, high]) = bounds(points) else { return 0.0 };
    MAX_SUPPORT_LOSS[0].min(MAX_SUPPORT_LOSS[1] * (high - low).amax())
}

/// A subset of `points` with at most `off` (m) less support than all points. `others(n)` is the support (m) of other
/// geometry along a unit vector n, which counts as part of the subset's support.
pub(crate) fn few(points: &[Vector3<f64>], others: impl Fn(&Vector3<f64>) -> f64, off: f64) -> Vec<Vector3<f64>> {
    let (places, outward) = hull(points);
    // Dropping a vertex loses most support in the direction in which this vertex alone is the farthest.
    let own =
        outward.into_iter().enumerate().map(|(k, n)| (n, k)).step_by(places.len().div_ceil(MAX_OWN_DIRECTIONS).max(1));
    let asked = farthest(&places, around(SUPPORT_DIRECTIONS)).chain(own);
    cover(&places, asked, others, off).into_iter().map(|k| places[k]).collect()
}

/// A subset of a mesh's vertices. The support of its hull differs from the mesh's by at most
/// [`MAX_REDUCTION_SHARE`] of the allowance.
pub(crate) fn corners(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    few(points, |_| f64::NEG_INFINITY, MAX_REDUCTION_SHARE * allowance(points))
}

/// Pairs each direction with the index of the farthest point along it.
pub(crate) fn farthest(
    points: &[Vector3<f64>],
    directions: impl Iterator<Item = Vector3<f64>>,
) -> impl Iterator<Item = (Vector3<f64>, usize)> {
    directions.filter_map(|n| {
        let far = |k: &usize| n.dot(&points[*k]);
        Some((n, (0..points.len()).max_by(|a, b| far(a).total_cmp(&far(b)))?))
    })
}

/// Indices of the subset that [`few`] describes, for given directions and their farthest points. Adds the point with
/// the largest loss of support until no loss exceeds `off` (m).
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

/// Vertices and triangles of the convex hull, counter-clockwise seen from outside; `None` for coplanar points.
pub(crate) fn faces(points: &[Vector3<f64>]) -> Option<Surface> {
    let own: Vec<_> = points.iter().map(|v| ParryVector::new(v.x, v.y, v.z)).collect();
    let (corners, faces) = std::panic::catch_unwind(|| try_convex_hull(&own).ok()).ok().flatten()?;
    Some((corners.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect(), faces))
}

/// Vertices of the convex hull, each with the mean normal of its faces; all points, without normals, if they are
/// coplanar.
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
