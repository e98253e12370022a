//! Primitive collision shapes and their contact points.

use crate::prelude::*;

/// Radius of the contact ball at a corner or an edge (m).
const SHARP_RADIUS: f64 = 1e-5;

/// A primitive collision shape fixed on a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Pose in the link frame.
    pub pose: Isometry3<f64>,
    /// Type and size.
    pub kind: ShapeKind,
    /// Index of the contact properties in the file's table, if the file has one.
    pub surface: Option<usize>,
}

/// Primitive shapes, centred at their pose; lengths in m. The axis of a cylinder or capsule is z; a capsule's length is
/// that of its straight part.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum ShapeKind {
    Sphere { radius: f64 },
    Box { half: Vector3<f64> },
    Cylinder { radius: f64, half_length: f64 },
    Capsule { radius: f64, half_length: f64 },
}

impl Shape {
    /// The contact points of this shape on link `link`. A sphere has its centre; a capsule the ends of its axis, the +z
    /// end first. A box has its corners (x fastest, negative first; radius 1e-5 m). A cylinder has three points on each
    /// rim (radius 1e-5 m), the +z rim first.
    pub fn contact_points(&self, link: usize) -> Vec<ContactPoint> {
        let at = |local: Vector3<f64>| self.pose.transform_point(&local.into()).coords;
        let point = |local: Vector3<f64>, radius: f64| ContactPoint::new(link, at(local), radius);
        let ends = |half_length: f64, radius: f64| [half_length, -half_length].map(|z| point(Vector3::z() * z, radius));
        let points: Vec<ContactPoint> = match self.kind {
            ShapeKind::Sphere { radius } => vec![point(Vector3::zeros(), radius)],
            ShapeKind::Capsule { radius, half_length } => ends(half_length, radius).into(),
            ShapeKind::Cylinder { radius, half_length } => {
                let axis = self.pose.rotation * Vector3::z_axis();
                [half_length, -half_length]
                    .into_iter()
                    .flat_map(|z| ContactPoint::disc(link, at(Vector3::z() * z), axis, radius, SHARP_RADIUS))
                    .collect()
            }
            ShapeKind::Box { half } => {
                let side = |corner: usize, bit: usize| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
                (0..8)
                    .map(|c| point(half.component_mul(&Vector3::new(side(c, 0), side(c, 1), side(c, 2))), SHARP_RADIUS))
                    .collect()
            }
        };
        points.into_iter().map(|point| point.on(self.surface)).collect()
    }
}
