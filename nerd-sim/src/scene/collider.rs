//! Static colliders as parry shapes, shared by all solvers including learned ones. A plane is solved in closed form,
//! not as a mesh.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::shape::SharedShape;

use super::parry::{from_parry, pose_to_parry, to_parry};
use super::{Field, Hull};
use crate::internal::*;

/// Maximum number of queries in the search for the deepest point of a disc or hull against a curved surface.
const MAX_QUERIES: usize = 4;

/// The half-space `normal . x <= offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, pointing outward.
    pub normal: Vector3<f64>,
    /// Offset of the surface from the world origin along the normal (m).
    pub offset: f64,
}

/// A static collider.
#[derive(Clone, Debug)]
pub struct Collider {
    /// Parry's shape.
    pub shape: SharedShape,
    /// World pose.
    pub pose: Isometry3<f64>,
    /// Contact material.
    pub material: Material,
    /// The plane if the shape is a half-space, solved in closed form.
    pub plane: Option<Plane>,
    /// Uneven ground, if set: heights along the z axis of `pose`. `shape` is then the half-space below height 0.
    pub field: Option<Field>,
    /// Bounding sphere of the shape, centre and radius (m) in the collider's axes, set by [`Collider::new`]. Far points
    /// skip the query. Update the sphere if you replace `shape`.
    pub ball: (Vector3<f64>, f64),
    /// Faces of the shape if it is a convex hull.
    pub hull: Option<Hull>,
    /// Surface number of the geom that made this collider; `None` unless the robot's file has that geom.
    pub surface: Option<usize>,
    /// Whether the scene states the material; otherwise the material is the robot's.
    pub stated: bool,
}

impl Collider {
    /// A half-space.
    pub fn plane(plane: Plane, material: Material) -> Self {
        let pose = Isometry3::translation(
            plane.normal.x * plane.offset,
            plane.normal.y * plane.offset,
            plane.normal.z * plane.offset,
        );
        let ball = (Vector3::zeros(), f64::INFINITY);
        Self {
            shape: SharedShape::halfspace(to_parry(&plane.normal)),
            pose,
            material,
            plane: Some(plane),
            field: None,
            hull: None,
            ball,
            surface: None,
            stated: false,
        }
    }

    /// Uneven ground, with heights along the z axis of `pose`.
    pub fn terrain(field: Field, pose: Isometry3<f64>, material: Material) -> Self {
        let ball = (Vector3::zeros(), f64::INFINITY);
        Self {
            shape: SharedShape::halfspace(ParryVector::Z),
            pose,
            material,
            plane: None,
            field: Some(field),
            hull: None,
            ball,
            surface: None,
            stated: false,
        }
    }

    /// Unit vector, in world axes, along which heights of uneven ground are measured.
    pub(crate) fn up(&self) -> Vector3<f64> {
        self.pose.rotation * Vector3::z()
    }

    /// A world point in the collider's axes (m).
    pub(crate) fn inside(&self, p0: &Vector3<f64>) -> Vector3<f64> {
        self.pose.rotation.inverse_transform_vector(&(p0 - self.pose.translation.vector))
    }

    /// The collider of a shape on a body with world pose `at`.
    pub(crate) fn shaped(Shape { pose, kind, surface }: &Shape, at: &Isometry3<f64>, material: Material) -> Self {
        let shape = match *kind {
            ShapeKind::Sphere { radius } => SharedShape::ball(radius),
            ShapeKind::Box { half } => SharedShape::cuboid(half.x, half.y, half.z),
            // Parry's cylinders lie along y.
            ShapeKind::Cylinder { radius, half_length } => {
                let along = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
                let own = Self::new(SharedShape::cylinder(half_length, radius), at * pose * along, material);
                return Self { surface: *surface, ..own };
            }
            ShapeKind::Capsule { radius, half_length } => SharedShape::capsule_z(half_length, radius),
        };
        Self { surface: *surface, ..Self::new(shape, at * pose, material) }
    }

    /// Any parry shape.
    pub fn new(shape: SharedShape, pose: Isometry3<f64>, material: Material) -> Self {
        let plane = shape.as_halfspace().map(|h| {
            let normal = pose.rotation * from_parry(&h.normal);
            Plane { normal, offset: normal.dot(&pose.translation.vector) }
        });
        let ball = shape.compute_local_bounding_sphere();
        Self {
            ball: (from_parry(&ball.center), ball.radius * (1.0 + 1e-9)),
            hull: Hull::of(&shape),
            shape,
            pose,
            material,
            plane,
            field: None,
            surface: None,
            stated: false,
        }
    }

    /// Refuses values that are not finite or out of range. Solvers call this in every frame.
    pub fn check(&self) -> Result<(), String> {
        let unit = |square: f64| (square - 1.0).abs() < 2e-6;
        let place = &self.pose.translation.vector;
        let turn = self.pose.rotation.quaternion();
        if let Some(Plane { normal, offset }) = &self.plane {
            if !(unit(normal.norm_squared()) && offset.is_finite()) {
                let normal = normal.as_slice();
                return Err(format!(
                    "the plane with normal {normal:?} and offset {offset} m: a unit vector and a finite number are needed"
                ));
            }
        } else {
            let bounds = self.shape.compute_local_aabb();
            if !(from_parry(&bounds.mins) + from_parry(&bounds.maxs)).iter().all(|x| x.is_finite()) {
                return Err("the size of the shape is not finite".into());
            }
        }
        if !(place.iter().all(|x| x.is_finite()) && unit(turn.norm_squared())) {
            let place = place.as_slice();
            let turn = turn.coords.as_slice();
            return Err(format!("its pose is at {place:?} m, turned by {turn:?}: finite numbers are needed"));
        }
        self.material.check()
    }

    /// Whether a bound proves the collider to be at least `reach` (m) from `p0`. The bound is cheaper than a query:
    /// bounding sphere, plane or hull faces. False for NaN.
    #[inline(always)]
    pub(crate) fn beyond(&self, p0: &Vector3<f64>, reach: f64) -> bool {
        let (centre, radius) = self.ball;
        match (&self.plane, &self.field) {
            (Some(plane), _) => plane.normal.dot(p0) - plane.offset >= reach,
            (_, Some(field)) => field.beyond(&self.inside(p0), reach),
            _ => {
                let far = (p0 - (self.pose.rotation * centre + self.pose.translation.vector)).norm() - radius >= reach;
                far || self.hull.as_ref().is_some_and(|hull| hull.beyond(&self.inside(p0), reach))
            }
        }
    }

    /// Nearest surface point, outward normal and signed distance for the world point `p0`.
    #[inline(always)]
    pub(crate) fn query(&self, p0: &Vector3<f64>) -> ContactEvent {
        if let Some(plane) = &self.plane {
            let distance = plane.normal.dot(p0) - plane.offset;
            return ContactEvent {
                p0: *p0,
                p1: p0 - plane.normal * distance,
                normal: plane.normal,
                distance,
                collider: 0,
            };
        }
        if let Some(field) = &self.field {
            let (distance, normal) = field.over(&self.inside(p0));
            let normal = self.pose.rotation * normal;
            return ContactEvent { p0: *p0, p1: p0 - normal * distance, normal, distance, collider: 0 };
        }
        let (p1, within) = match &self.hull {
            Some(hull) => {
                let (place, within) = hull.nearest(&self.inside(p0));
                (self.pose.rotation * place + self.pose.translation.vector, within)
            }
            None => {
                let found = self.shape.project_point(&pose_to_parry(&self.pose), to_parry(p0), false);
                (from_parry(&found.point), found.is_inside)
            }
        };
        let gap = p0 - p1;
        let sign = if within { -1.0 } else { 1.0 };
        let length = gap.norm();
        let normal = if length > 1e-12 { gap * (sign / length) } else { Vector3::zeros() };
        ContactEvent { p0: *p0, p1, normal, distance: sign * length, collider: 0 }
    }

    /// Contact event, as from [`Collider::query`], for a contact point of a link. `data` holds the kinematics;
    /// `middle`: the contact point's centre (m, world axes). A distance beyond `reach` (m) may be underestimated, but
    /// not below `reach`.
    #[inline(always)]
    pub(crate) fn meets(&self, point: &ContactPoint, data: &Data, middle: &Vector3<f64>, reach: f64) -> ContactEvent {
        if point.locus.is_fixed() { self.query(middle) } else { self.search(point, data, middle, reach) }
    }

    #[inline(never)]
    pub(crate) fn search(&self, point: &ContactPoint, data: &Data, middle: &Vector3<f64>, reach: f64) -> ContactEvent {
        let rotation = &data.rotation[point.link];
        let at = |local: &Vector3<f64>| point_position(data, point.link, local);
        if let Some(plane) = &self.plane {
            return self.query(&at(&point.facing(rotation, &plane.normal)));
        }
        let first = self.query(middle);
        if self.field.is_none() {
            // Among supporting planes of the convex shape, find the one with the largest signed distance from the link.
            let mut best = ContactEvent { distance: f64::NEG_INFINITY, ..first };
            let mut event = first;
            for _ in 0..MAX_QUERIES {
                let place = at(&point.facing(rotation, &event.normal));
                let distance = event.normal.dot(&(place - event.p1));
                if distance.is_nan() || distance > best.distance {
                    best = ContactEvent { p0: place, distance, ..event };
                }
                if distance >= reach {
                    break;
                }
                event = self.query(&place);
                if event.normal == Vector3::zeros() {
                    break;
                }
            }
            return best;
        }
        let mut normal = first.normal;
        let mut nearest = f64::INFINITY;
        // On a curved surface, the normal at the deepest point determines the deepest point: iterate.
        for _ in 0..MAX_QUERIES {
            let event = self.query(&at(&point.deepest(rotation, &normal)));
            if event.distance >= nearest || event.normal == Vector3::zeros() {
                break;
            }
            (nearest, normal) = (event.distance, event.normal);
        }
        self.query(&at(&point.facing(rotation, &normal)))
    }
}
