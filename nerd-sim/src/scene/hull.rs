//! Convex hulls of triangles, with distance queries.

use parry3d_f64::shape::SharedShape;

use super::parry::from_parry;
use crate::internal::*;

/// Ratio of height to length below which a triangle is left out.
const MIN_HEIGHT_RATIO: f64 = 1e-4;

/// A triangular face.
#[derive(Clone, Debug)]
struct Face {
    corners: [Vector3<f64>; 3],
    /// Unit normal, pointing outward, and the offset of the face along it (m).
    normal: Vector3<f64>,
    offset: f64,
}

/// The faces of a convex hull.
#[derive(Clone, Debug)]
pub struct Hull(Arc<[Face]>);

impl Hull {
    /// The hull of a parry shape, if the shape is a convex polyhedron.
    pub(crate) fn of(shape: &SharedShape) -> Option<Self> {
        let (vertices, faces) = shape.as_convex_polyhedron()?.to_trimesh();
        let face = |face: &[u32; 3]| {
            let corners @ [a, b, c] = face.map(|k| from_parry(&vertices[k as usize]));
            // A very thin triangle is left out: its normal is rounding noise, and neighbouring faces are as near.
            let normal = (b - a)
                .cross(&(c - a))
                .try_normalize(MIN_HEIGHT_RATIO * (b - a).norm_squared().max((c - a).norm_squared()))?;
            Some(Face { corners, normal, offset: normal.dot(&a) })
        };
        Some(Self(faces.iter().filter_map(face).collect()))
    }

    /// Largest signed distance (m) of `x` from the face planes, and its face. This is a lower bound of the distance
    /// from the hull.
    fn highest(&self, x: &Vector3<f64>) -> (f64, usize) {
        let high = |best: (f64, usize), (k, face): (usize, &Face)| {
            let high = face.normal.dot(x) - face.offset;
            if high > best.0 { (high, k) } else { best }
        };
        self.0.iter().enumerate().fold((f64::NEG_INFINITY, 0), high)
    }

    /// Whether a lower bound proves the hull to be at least `reach` (m) from `x`.
    pub(crate) fn beyond(&self, x: &Vector3<f64>, reach: f64) -> bool {
        self.highest(x).0 >= reach
    }

    /// Nearest surface point, and whether `x` is inside.
    pub(crate) fn nearest(&self, x: &Vector3<f64>) -> (Vector3<f64>, bool) {
        let (high, k) = self.highest(x);
        let Some(face) = self.0.get(k) else { return (*x, false) };
        if high <= 0.0 {
            return (x - face.normal * high, true);
        }
        let (mut place, mut least) = face.nearest(x, high);
        // A visible face's plane is at most as far as the face, so farther planes can be skipped.
        if least > high * high * (1.0 + 1e-12) {
            for face in self.0.iter() {
                let high = face.normal.dot(x) - face.offset;
                if high > 0.0 && high * high < least {
                    let (own, square) = face.nearest(x, high);
                    (place, least) = if square < least { (own, square) } else { (place, least) };
                }
            }
        }
        (place, false)
    }

    /// Number of faces, then for each face its corners relative to `middle` (m) and its normal.
    pub(crate) fn numbers(&self, middle: &Vector3<f64>) -> Vec<f64> {
        let face = |face: &Face| {
            face.corners.map(|corner| corner - middle).into_iter().chain([face.normal]).collect::<Vec<_>>()
        };
        let all = self.0.iter().flat_map(face).flat_map(|v| [v.x, v.y, v.z]);
        std::iter::once(self.0.len() as f64).chain(all).collect()
    }

    /// Whether both hulls share the same memory.
    pub(crate) fn shares(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Face {
    /// Nearest point of the face to `x` at height `high` above its plane, and the squared distance. This is the
    /// projection of `x`, or a point on an edge if the projection lies beyond the edge.
    fn nearest(&self, x: &Vector3<f64>, high: f64) -> (Vector3<f64>, f64) {
        let foot = x - self.normal * high;
        let mut best = None::<(Vector3<f64>, f64)>;
        for (k, a) in self.corners.iter().enumerate() {
            let edge = self.corners[(k + 1) % 3] - a;
            if edge.cross(&(foot - a)).dot(&self.normal) < 0.0 {
                let at = a + edge * ((x - a).dot(&edge) / edge.norm_squared()).clamp(0.0, 1.0);
                let square = (x - at).norm_squared();
                best = best.filter(|own| own.1 <= square).or(Some((at, square)));
            }
        }
        best.unwrap_or((foot, high * high))
    }
}

#[cfg(test)]
mod tests {
    use parry3d_f64::math::Vector as ParryVector;

    use super::*;
    use crate::scene::to_parry;

    /// The hull of a box's corners gives the same distances as the box inside and outside, and `beyond` never
    /// overestimates.
    #[test]
    fn the_hull_of_a_box_is_the_box() {
        let half = [0.3, 0.2, 0.1];
        let corner = |k: usize| {
            ParryVector::new(half[0], half[1], half[2]) * ParryVector::new(sign(k), sign(k >> 1), sign(k >> 2))
        };
        let shape = SharedShape::convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).expect("a hull");
        let hull = Hull::of(&shape).expect("faces");
        let cuboid = SharedShape::cuboid(half[0], half[1], half[2]);
        let mut rng = crate::random::stream(3, 0);
        let mut inside = 0;
        for _ in 0..2000 {
            let x = Vector3::from_fn(|_, _| rand::RngExt::random_range(&mut rng, -0.5..0.5));
            let expected = cuboid.project_local_point(to_parry(&x), false);
            let (place, within) = hull.nearest(&x);
            let [own, theirs] = [place, from_parry(&expected.point)].map(|place| (place - x).norm());
            assert!(within == expected.is_inside && (own - theirs).abs() < 1e-12, "{x}: {own} m, not {theirs} m");
            let distance = if within { -own } else { own };
            assert!(!hull.beyond(&x, distance + 1e-9), "{x} is taken for farther than {distance} m");
            inside += usize::from(within);
        }
        assert!((50..500).contains(&inside), "{inside} of 2000 places inside");
    }

    fn sign(k: usize) -> f64 {
        if k & 1 == 0 { -1.0 } else { 1.0 }
    }
}
