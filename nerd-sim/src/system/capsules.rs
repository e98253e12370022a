//! Fits capsules to a robot's links for self-collision, and computes the gap between two capsules.
//!
//! Spheres and capsules are exact. A long cylinder becomes a capsule of its radius and length. A flat cylinder and a
//! box become capsules side by side along their longest axis, as thick as the shape. Edges are thereby rounded, by 0.41
//! of the smallest half extent at an edge and 0.73 at a corner. The convex hull of a mesh becomes the smaller of two
//! boxes; its capsules are shortened and thinned to fit inside the hull.

use std::f64::consts::PI;

use nalgebra::{Rotation3, Translation3};

use crate::internal::*;

/// Largest spacing of neighbouring capsules, in radii: the dip between two is then a third of a radius deep.
const MAX_SPACING: f64 = 1.5;
/// Maximum number of capsules side by side; a wider, flatter shape gets thicker capsules.
const MAX_ROWS: usize = 12;
/// Thinnest capsule (m).
const MIN_RADIUS: f64 = 1e-4;
/// Share of the squared sum of two radii that is added to the squared distance of two capsules at an end. Capsules are
/// thus slightly barrel-shaped: at an end they are thinner by R / 4000, with R the sum of the two radii. For parallel
/// capsules side by side, the contact position becomes a continuous function of the pose and the gap differentiable.
pub(crate) const BARREL: f64 = 1.0 / 2000.0;

/// All points within `radius` of the segment from `middle - half` to `middle + half` (m, link frame).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Capsule {
    pub(crate) middle: Vector3<f64>,
    pub(crate) half: Vector3<f64>,
    pub(crate) radius: f64,
}

pub(crate) struct Meeting {
    /// Distance (m) between the surfaces of two capsules, negative when they overlap.
    pub(crate) gap: f64,
    /// Gradient of the gap with respect to the first capsule's position: a unit vector up to the share [`BARREL`].
    pub(crate) normal: Vector3<f64>,
    pub(crate) place: Vector3<f64>,
}

impl Capsule {
    /// Contact with another capsule, at the pair of points `x = m + s h` on the two axes, s from -1 to 1. The pair has
    /// the least `|x_1 - x_2|^2 + BARREL R^2 (s_1^2 + s_2^2)`. R is the sum of the radii (m).
    #[inline]
    pub(crate) fn meets(&self, other: &Self) -> Meeting {
        let u = &self.half;
        let v = &other.half;
        let apart = self.middle - other.middle;
        let reach = self.radius + other.radius;
        let barrel = BARREL * reach * reach;
        let (uu, vv, uv) = (u.dot(u) + barrel, v.dot(v) + barrel, u.dot(v));
        let (ud, vd) = (u.dot(&apart), v.dot(&apart));
        let mut s = ((uv * vd - vv * ud) / (uu * vv - uv * uv)).clamp(-1.0, 1.0);
        let best = (vd + uv * s) / vv;
        let t = best.clamp(-1.0, 1.0);
        if best != t {
            s = ((uv * t - ud) / uu).clamp(-1.0, 1.0);
        }
        let between = apart + u * s - v * t;
        let distance = (between.dot(&between) + barrel * (s * s + t * t)).sqrt();
        let place = other.middle + v * t + between * (other.radius / reach);
        // Where the axes cross, the normal is undefined and set to zero, so there is no force.
        let normal = if distance > 0.0 { between / distance } else { between };
        Meeting { gap: distance - reach, normal, place }
    }

    /// The capsule in other axes.
    #[inline]
    pub(crate) fn moved(&self, rotation: &Matrix3<f64>, position: &Vector3<f64>) -> Self {
        Self { middle: position + rotation * self.middle, half: rotation * self.half, radius: self.radius }
    }

    pub(crate) fn of_shape(shape: &Shape) -> Vec<Self> {
        let axis = |half_length: f64, radius: f64| {
            (radius > 0.0).then(|| along(&shape.pose, 2, half_length, radius)).into_iter().collect()
        };
        match shape.kind {
            ShapeKind::Sphere { radius } => axis(0.0, radius),
            ShapeKind::Capsule { radius, half_length } => axis(half_length, radius),
            ShapeKind::Cylinder { radius, half_length } if half_length >= radius => axis(half_length - radius, radius),
            ShapeKind::Cylinder { radius, half_length } => {
                let half = Vector3::new(radius, radius, half_length);
                rows(&shape.pose, half, |y, thin| ((radius - thin).powi(2) - y * y).max(0.0).sqrt())
            }
            ShapeKind::Box { half } => rows(&shape.pose, half, |_, thin| half.max() - thin),
        }
    }

    /// Capsules of a convex hull, from its vertices (m, link frame).
    pub(crate) fn of_hull(vertices: &[Vector3<f64>]) -> Vec<Self> {
        let Some(room) = Room::of(vertices) else { return Vec::new() };
        let (pose, half) = boxed(vertices);
        let bars = rows(&pose, half, |_, thin| half.max() - thin);
        bars.iter().filter_map(|bar| room.fit(bar)).collect()
    }

    /// Whether this capsule lies inside another, up to rounding.
    pub(crate) fn within(&self, other: &Self) -> bool {
        [-1.0, 1.0].iter().all(|s| other.outside(&(self.middle + self.half * *s)) + self.radius < 1e-9)
    }

    /// Distance (m) of a point from the capsule's surface, positive outside.
    fn outside(&self, place: &Vector3<f64>) -> f64 {
        let length = self.half.norm_squared();
        let s = if length > 0.0 { ((place - self.middle).dot(&self.half) / length).clamp(-1.0, 1.0) } else { 0.0 };
        (place - self.middle - self.half * s).norm() - self.radius
    }
}

/// Largest distance (m) of a link's contact points outside its capsules.
pub(crate) fn rounded(points: &[ContactPoint], capsules: &[Capsule]) -> f64 {
    let out = |place: &Vector3<f64>| capsules.iter().map(|c| c.outside(place)).fold(f64::INFINITY, f64::min);
    points.iter().flat_map(|p| p.places().into_iter().map(move |x| out(&x) + p.radius)).fold(0.0, f64::max)
}

fn along(pose: &Isometry3<f64>, axis: usize, half_length: f64, radius: f64) -> Capsule {
    let half = pose.rotation * (Vector3::ith(axis, 1.0) * half_length.max(0.0));
    Capsule { middle: pose.translation.vector, half, radius: radius.max(MIN_RADIUS) }
}

/// Capsules side by side for a flat box or cylinder with half extents `half` (m). `reach(y, radius)` is half the axis
/// length (m) of the capsule at offset y (m).
fn rows(pose: &Isometry3<f64>, half: Vector3<f64>, reach: impl Fn(f64, f64) -> f64) -> Vec<Capsule> {
    if half.max() <= 0.0 {
        return Vec::new();
    }
    let (long, flat) = (half.imax(), half.imin());
    let flat = if flat == long { (long + 2) % 3 } else { flat };
    let side = 3 - long - flat;
    let wide = half[side];
    let thin = half[flat].max(wide / (1.0 + 0.5 * MAX_SPACING * (MAX_ROWS - 1) as f64)).max(MIN_RADIUS).min(half[long]);
    let gaps = ((wide - thin) / (0.5 * MAX_SPACING * thin) - 1e-9).ceil().max(0.0);
    let place = |k: usize| if gaps > 0.0 { (2.0 * k as f64 / gaps - 1.0) * (wide - thin) } else { 0.0 };
    let row = |y: f64| along(&(pose * Translation3::from(Vector3::ith(side, y))), long, reach(y, thin), thin);
    (0..=gaps as usize).map(|k| row(place(k))).collect()
}

/// The smaller of two bounding boxes of vertices: along the link's axes, and along the principal axes of their
/// covariance.
fn boxed(vertices: &[Vector3<f64>]) -> (Isometry3<f64>, Vector3<f64>) {
    let mean = vertices.iter().sum::<Vector3<f64>>() / vertices.len() as f64;
    let spread: Matrix3<f64> = vertices.iter().map(|v| (v - mean) * (v - mean).transpose()).sum();
    let mut axes = spread.symmetric_eigen().eigenvectors;
    if axes.determinant() < 0.0 {
        axes = -axes;
    }
    let about = |turn: Rotation3<f64>| {
        let ends =
            vertices.iter().map(|v| turn.inverse() * v).fold(None, |ends: Option<(Vector3<f64>, Vector3<f64>)>, v| {
                Some(ends.map_or((v, v), |(low, high)| (low.inf(&v), high.sup(&v))))
            });
        let (low, high) = ends.unwrap_or_default();
        (Isometry3::from_parts((turn * (low + high) * 0.5).into(), turn.into()), (high - low) * 0.5)
    };
    let two = [about(Rotation3::identity()), about(Rotation3::from_matrix_unchecked(axes))];
    let size = |(_, half): &(_, Vector3<f64>)| half.product();
    if size(&two[0]) <= size(&two[1]) { two[0] } else { two[1] }
}

/// Inside of a convex hull, as the hull's support (m) along many unit vectors.
struct Room(Vec<(Vector3<f64>, f64)>);

/// Number of support directions, and of stations along a capsule.
const DIRECTIONS: usize = 200;
const STATIONS: usize = 11;
/// [`MIN_END_RADIUS`]: least free radius along a fitted capsule, as a share of the largest; ends with less are cut off.
/// [`MIN_RADIUS_SHARE`]: least radius of a fitted capsule, as a share of its radius in the box; thinner capsules are
/// dropped.
const MIN_END_RADIUS: f64 = 0.6;
const MIN_RADIUS_SHARE: f64 = 0.3;

impl Room {
    fn of(vertices: &[Vector3<f64>]) -> Option<Self> {
        let direction = |k: usize| {
            let z = 1.0 - (2 * k + 1) as f64 / DIRECTIONS as f64;
            let turn = k as f64 * PI * (3.0 - 5f64.sqrt());
            let flat = (1.0 - z * z).sqrt();
            Vector3::new(flat * turn.cos(), flat * turn.sin(), z)
        };
        let far = |n: Vector3<f64>| (n, vertices.iter().map(|v| n.dot(v)).fold(f64::NEG_INFINITY, f64::max));
        (!vertices.is_empty()).then(|| Self((0..DIRECTIONS).map(direction).map(far).collect()))
    }

    /// Radius (m) of the largest sphere about `place` that lies inside the hull.
    fn at(&self, place: &Vector3<f64>) -> f64 {
        self.0.iter().map(|(n, far)| far - n.dot(place)).fold(f64::INFINITY, f64::min)
    }

    /// The part of a capsule inside the hull; its ends may stick out slightly.
    fn fit(&self, bar: &Capsule) -> Option<Capsule> {
        let station = |k: usize| 2.0 * k as f64 / (STATIONS - 1) as f64 - 1.0;
        let room: Vec<f64> =
            (0..STATIONS).map(|k| self.at(&(bar.middle + bar.half * station(k))).min(bar.radius)).collect();
        let most = room.iter().copied().fold(0.0, f64::max);
        let kept = |k: &usize| room[*k] >= MIN_END_RADIUS * most;
        let (first, last) = ((0..STATIONS).find(kept)?, (0..STATIONS).rfind(kept)?);
        let radius = room[first..=last].iter().sum::<f64>() / (last + 1 - first) as f64;
        let (a, b) = (station(first), station(last));
        let fitted = Capsule {
            middle: bar.middle + bar.half * (0.5 * (a + b)),
            half: bar.half * (0.5 * (b - a)),
            radius: radius.max(MIN_RADIUS),
        };
        (most >= MIN_RADIUS_SHARE * bar.radius || most <= MIN_RADIUS).then_some(fitted)
    }
}
