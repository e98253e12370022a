//! Static bodies as parry shapes, the same for every solver, the learned one included. A plane is solved in closed form, never as a mesh.

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::shape::SharedShape;

use super::parry::{from_parry, pose_to_parry, to_parry};
use super::{Field, Hull};
use crate::internal::*;

/// Queries at most that find the deepest place of a disc or hull against what is not flat.
const SEARCHES: usize = 4;

/// The half-space `normal . x <= offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal, pointing out.
    pub normal: Vector3<f64>,
    /// Distance of the surface from the world's origin along the normal (m).
    pub offset: f64,
}

/// One static body.
#[derive(Clone, Debug)]
pub struct Collider {
    /// Its shape.
    pub shape: SharedShape,
    /// Its pose in the world.
    pub pose: Isometry3<f64>,
    /// Its material.
    pub material: Material,
    /// Set if the shape is a half-space, which is then answered in closed form.
    pub plane: Option<Plane>,
    /// Set if it is ground that is not flat: heights along the z axis of its pose. Its shape is the half-space below height 0.
    pub field: Option<Field>,
    /// Centre and radius (m) of a ball around the shape, in its own axes, which [`Collider::new`] finds: a place far outside is not asked
    /// how far. Another shape needs another one.
    pub ball: (Vector3<f64>, f64),
    /// Set if it is a convex hull of corners.
    pub hull: Option<Hull>,
    /// Number of its geom in the robot's file, if it is one of that.
    pub surface: Option<usize>,
    /// Whether a scene says its material.
    pub stated: bool,
}

impl Collider {
    /// A plane.
    pub fn plane(plane: Plane, material: Material) -> Self {
        let pose = Isometry3::translation(plane.normal.x * plane.offset, plane.normal.y * plane.offset, plane.normal.z * plane.offset);
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

    /// Ground that is not flat, its heights along the z axis of its pose.
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

    /// The direction of its heights.
    pub(crate) fn up(&self) -> Vector3<f64> {
        self.pose.rotation * Vector3::z()
    }

    /// A place in its own axes (m).
    pub(crate) fn inside(&self, p0: &Vector3<f64>) -> Vector3<f64> {
        self.pose.rotation.inverse_transform_vector(&(p0 - self.pose.translation.vector))
    }

    /// A shape of a body at `at`.
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

    /// Any other parry shape.
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

    /// Says what is not finite or out of its range, if anything is. Solvers ask in every frame.
    pub fn check(&self) -> Result<(), String> {
        let unit = |square: f64| (square - 1.0).abs() < 2e-6;
        let (place, turn) = (&self.pose.translation.vector, self.pose.rotation.quaternion());
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
            let (place, turn) = (place.as_slice(), turn.coords.as_slice());
            return Err(format!("its pose is at {place:?} m, turned by {turn:?}: finite numbers are needed"));
        }
        self.material.check()
    }

    /// Whether no place of it is nearer to `p0` than `reach` (m), as far as a ball around it tells: sooner than a query does. Of what is no
    /// number it is not known.
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

    /// Nearest point and outward normal of the surface for the world point `p0`.
    #[inline(always)]
    pub(crate) fn query(&self, p0: &Vector3<f64>) -> ContactEvent {
        if let Some(plane) = &self.plane {
            let distance = plane.normal.dot(p0) - plane.offset;
            return ContactEvent { p0: *p0, p1: p0 - plane.normal * distance, normal: plane.normal, distance, collider: 0 };
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
        let (gap, sign) = (p0 - p1, if within { -1.0 } else { 1.0 });
        let length = gap.norm();
        let normal = if length > 1e-12 { gap * (sign / length) } else { Vector3::zeros() };
        ContactEvent { p0: *p0, p1, normal, distance: sign * length, collider: 0 }
    }

    /// The same for a contact point wherever it lies on its link, whose kinematics are in `data`; `middle` is its middle in the world. Of what is
    /// farther than `reach` (m) the distance may be less than it is, and no less than that.
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
        if self.hull.is_some() {
            // Of planes that touch the hull the one that the link is farthest over, or least under.
            let (mut best, mut event) = (ContactEvent { distance: f64::NEG_INFINITY, ..first }, first);
            for _ in 0..SEARCHES {
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
        let (mut normal, mut nearest) = (first.normal, f64::INFINITY);
        // Where the surface is not flat, its normal at the deepest place decides which place that is.
        for _ in 0..SEARCHES {
            let event = self.query(&at(&point.deepest(rotation, &normal)));
            if event.distance >= nearest || event.normal == Vector3::zeros() {
                break;
            }
            (nearest, normal) = (event.distance, event.normal);
        }
        self.query(&at(&point.facing(rotation, &normal)))
    }
}
