//! Contact points of links, contact quantities `c = (p0, p1, n, d)` of the paper (A.1) and the threshold of their mask.
//!
//! Contacts are found by geometry: a fixed list of points on the robot is tested against the scene once a frame. The
//! distance `d = n . (p0 - p1)` is measured from the contact point itself. The point is the centre of a sphere or of a
//! capsule's end, a place on a cylinder's rim, or a vertex of a hull. So the surfaces touch at `d = radius`.

use std::{f64::consts::TAU, sync::Arc};

use nalgebra::{Matrix3, Rotation3, UnitVector3, Vector3};

/// Candidate contact point of a link. The point's [`Locus`] says whether it moves over the link from frame to frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactPoint {
    /// Index of the link.
    pub link: usize,
    /// Position in the link frame (m). For a moving point, the middle of the region in which it moves.
    pub local: Vector3<f64>,
    /// Radius (m) of the ball around the point in the contact law.
    pub radius: f64,
    /// Contact thickness (m), which sets the distance at which the contact is masked ([`ContactPoint::threshold`]).
    pub thickness: f64,
    /// Where on the link the point can be.
    pub locus: Locus,
    /// Index into the contact-property table of the robot's file, if the file has one.
    pub surface: Option<usize>,
}

/// Region of a link that a contact point may occupy. At each moment the point is where the region faces the surface
/// that it meets.
#[derive(Clone, Debug, PartialEq)]
pub enum Locus {
    /// At `local`.
    Fixed,
    /// On the rim of a disc about `local`: the rim's deepest point, rotated by the angle `turn` about the disc's axis.
    ///
    /// A disc has three such points, at angles 0 and +-120 degrees. So a standing cylinder has the same stiffness in
    /// all directions, `sum r r^T = 3/2 R^2`, wherever the first point lies. The points at +-120 degrees have equal
    /// gaps, so their movement along the rim does no work.
    Rim {
        /// Axis, link frame.
        axis: UnitVector3<f64>,
        /// Radius of the disc (m).
        radius: f64,
        /// Angle of the point from the rim's deepest point (rad).
        turn: f64,
    },
    /// At the deepest of several vertices, so that the gap is a continuous function of the link's pose.
    Hull {
        /// The vertices (m, link frame).
        vertices: Arc<[Vector3<f64>]>,
        /// Largest distance of a vertex from the vertices' mean (m).
        reach: f64,
    },
}

/// Below this sine of the angle between a disc's axis and the surface normal, the whole rim counts as equally deep.
const MIN_TILT_SINE: f64 = 1e-9;

impl ContactPoint {
    /// A point fixed at `local` (m, link frame), with radius and thickness `radius` (m).
    pub fn new(link: usize, local: Vector3<f64>, radius: f64) -> Self {
        Self { link, local, radius, thickness: radius, locus: Locus::Fixed, surface: None }
    }

    /// The three contact points of a disc. `centre` (m) and `axis` are in the link frame. `rim` is the disc's radius
    /// (m), `radius` that of its edge (m).
    pub fn disc(link: usize, centre: Vector3<f64>, axis: UnitVector3<f64>, rim: f64, radius: f64) -> [Self; 3] {
        [0.0, TAU / 3.0, -TAU / 3.0]
            .map(|turn| Self { locus: Locus::Rim { axis, radius: rim, turn }, ..Self::new(link, centre, radius) })
    }

    /// A contact point at the deepest of `vertices` (m, link frame), each vertex a ball of `radius` (m).
    pub fn hull(link: usize, vertices: impl Into<Arc<[Vector3<f64>]>>, radius: f64) -> Self {
        let vertices = vertices.into();
        let middle = vertices.iter().sum::<Vector3<f64>>() / vertices.len().max(1) as f64;
        let reach = vertices.iter().map(|v| (v - middle).norm()).fold(0.0, f64::max);
        Self { locus: Locus::Hull { vertices, reach }, ..Self::new(link, middle, radius) }
    }

    /// Sets the index of the contact properties in the table of the robot's file.
    pub fn on(self, surface: Option<usize>) -> Self {
        Self { surface, ..self }
    }

    /// Distance beyond which a contact is masked, `xi = max(4 thickness, 0.1)` m (paper A.1).
    pub fn threshold(&self) -> f64 {
        (4.0 * self.thickness).max(0.1)
    }

    /// Position in the link frame (m) when the point faces a surface of outward unit `normal`. `rotation` maps link
    /// axes to the axes of `normal`.
    #[inline(always)]
    pub fn facing(&self, rotation: &Matrix3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
        match &self.locus {
            Locus::Fixed => self.local,
            locus => locus.facing(&self.local, &rotation.tr_mul(normal), true),
        }
    }

    /// The deepest position (m, link frame) on the disc or hull, from which the distance to a surface is taken.
    /// Arguments are those of `Self::facing`.
    pub fn deepest(&self, rotation: &Matrix3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
        self.locus.facing(&self.local, &rotation.tr_mul(normal), false)
    }

    /// Velocity (m/s, axes of the normal) of a rim point relative to the disc's centre; `spin` (rad/s) is the link's
    /// angular velocity. For `turn = 0` this velocity is `-R t_dot`, with `t = s / |s|`, `s = n - (n . a) a`, `a_dot =
    /// w x a`. The velocity is zero for other loci. Where the whole rim is nearly equally deep, the rate of t is
    /// limited to one radian per `time` (s).
    pub fn runs(&self, rotation: &Matrix3<f64>, normal: &Vector3<f64>, spin: &Vector3<f64>, time: f64) -> Vector3<f64> {
        let Locus::Rim { axis, radius, turn } = &self.locus else { return Vector3::zeros() };
        let axis = rotation * axis.as_ref();
        let axis_rate = spin.cross(&axis);
        let slope = normal - axis * axis.dot(normal);
        let size = slope.norm();
        if size <= MIN_TILT_SINE {
            return Vector3::zeros();
        }
        let up = slope / size;
        let slope_rate = -axis * normal.dot(&axis_rate) - axis_rate * normal.dot(&axis);
        let up_rate = (slope_rate - up * up.dot(&slope_rate)) * (size / (size * size + (time * spin.norm()).powi(2)));
        let (sin, cos) = turn.sin_cos();
        -(up_rate * cos + (axis_rate.cross(&up) + axis.cross(&up_rate)) * sin) * *radius
    }

    /// Largest distance (m) of the contact point from `local`.
    pub fn reach(&self) -> f64 {
        match &self.locus {
            Locus::Fixed => 0.0,
            Locus::Rim { radius: reach, .. } | Locus::Hull { reach, .. } => *reach,
        }
    }

    /// Positions (m, link frame) that outline the point's region: twelve on the rim of a disc, all vertices of a hull.
    pub fn places(&self) -> Vec<Vector3<f64>> {
        match &self.locus {
            Locus::Fixed => vec![self.local],
            Locus::Rim { axis, radius, .. } => {
                let out = across(axis) * *radius;
                (0..12)
                    .map(|k| self.local + Rotation3::from_axis_angle(axis, TAU * f64::from(k) / 12.0) * out)
                    .collect()
            }
            Locus::Hull { vertices, .. } => vertices.to_vec(),
        }
    }

    /// The same contact point on a link whose lengths are multiplied by `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        let locus = match &self.locus {
            Locus::Fixed => Locus::Fixed,
            Locus::Rim { axis, radius, turn } => Locus::Rim { axis: *axis, radius: radius * factor, turn: *turn },
            Locus::Hull { vertices, reach } => {
                Locus::Hull { vertices: vertices.iter().map(|v| v * factor).collect(), reach: reach * factor }
            }
        };
        Self {
            local: self.local * factor,
            radius: self.radius * factor,
            thickness: self.thickness * factor,
            locus,
            ..*self
        }
    }
}

impl Locus {
    /// Whether the point is fixed on the link.
    #[inline(always)]
    pub fn is_fixed(&self) -> bool {
        matches!(self, Self::Fixed)
    }

    /// Position (m, link frame) of the contact point on a surface with outward unit `normal` (link frame). On a disc:
    /// the rim's point at angle `turn` from the deepest if `own`, else the deepest. On a hull: the deepest vertex.
    fn facing(&self, middle: &Vector3<f64>, normal: &Vector3<f64>, own: bool) -> Vector3<f64> {
        match self {
            Self::Fixed => *middle,
            Self::Rim { axis, radius, turn } => {
                let slope = normal - axis.as_ref() * axis.dot(normal);
                let size = slope.norm();
                let up = if size > MIN_TILT_SINE { slope / size } else { across(axis) };
                let (sin, cos) = if own { turn.sin_cos() } else { (0.0, 1.0) };
                middle - (up * cos + axis.cross(&up) * sin) * *radius
            }
            Self::Hull { vertices, .. } => {
                let mut least = f64::INFINITY;
                let mut deepest = middle;
                for vertex in vertices.iter() {
                    let height = normal.dot(vertex);
                    if height < least {
                        (least, deepest) = (height, vertex);
                    }
                }
                *deepest
            }
        }
    }
}

/// A unit vector perpendicular to `axis`.
pub fn across(axis: &UnitVector3<f64>) -> Vector3<f64> {
    axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize()
}

/// Result of the collision query for one contact point. Positions and normal are in world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactEvent {
    /// The point on the robot (m).
    pub p0: Vector3<f64>,
    /// The nearest point of the scene (m).
    pub p1: Vector3<f64>,
    /// Outward unit normal of the scene's surface at `p1`.
    pub normal: Vector3<f64>,
    /// Signed distance `n . (p0 - p1)` (m), negative in penetration, infinite in an empty scene.
    pub distance: f64,
    /// Index of the collider in the scene.
    pub collider: usize,
}

impl ContactEvent {
    /// The event of a contact point at `p0` (m, world) with no scene in reach.
    pub fn none(p0: Vector3<f64>) -> Self {
        Self { p0, p1: Vector3::zeros(), normal: Vector3::zeros(), distance: f64::INFINITY, collider: 0 }
    }
}
