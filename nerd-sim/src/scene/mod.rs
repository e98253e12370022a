//! Scenes: gravity and static colliders, everything that is not the robot.

mod collider;
mod field;
mod hull;
mod parry;
mod spec;
mod surfaces;
mod terrain;
mod worlds;

use crate::internal::*;

pub use collider::{Collider, Plane};
pub use field::{Field, TerrainKind, TerrainSpec};
pub use hull::Hull;
pub(crate) use parry::to_parry;
#[cfg(feature = "rapier")]
pub(crate) use parry::{from_parry, pose_from_parry, pose_to_parry};
pub(crate) use spec::is_zero;
pub use spec::{BoxSpec, Material, PegSpec, PlaneSpec, SceneSpec};
pub use surfaces::{Meeting, PairLaw, Softness, SurfaceGeom, Surfaces};
pub use worlds::{WORLDS, hill, world};
pub(crate) use worlds::{described, flat, peg};

/// Default gravity (m/s^2).
pub const GRAVITY: f64 = 9.81;

/// Least depth (m) inside another collider for a surface point to count as covered.
const MIN_COVERED_DEPTH: f64 = 1e-6;

/// Gravity and static colliders.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name, as on the command line.
    pub name: String,
    /// Gravity (m/s^2), world axes.
    pub gravity: Vector3<f64>,
    /// Static bodies.
    pub colliders: Vec<Collider>,
}

impl Scene {
    /// Empty space with gravity.
    pub fn free(gravity: Vector3<f64>) -> Self {
        Self { name: "free".into(), gravity, colliders: Vec::new() }
    }

    /// Contact event of the nearest collider for the world point `p0`.
    #[inline]
    pub fn contact(&self, p0: &Vector3<f64>) -> ContactEvent {
        self.nearest(p0, 0.0, |_| true, |body| body.query(p0))
    }

    /// Contact event of the nearest collider for a contact point of a robot; `data` has the kinematics.
    #[inline]
    pub fn meets(&self, point: &ContactPoint, data: &Data, surfaces: &Surfaces) -> ContactEvent {
        let middle = point_position(data, point.link, &point.local);
        self.nearest(
            &middle,
            point.reach(),
            |body| surfaces.meeting(point, body).is_some(),
            |body| body.meets(point, data, &middle, f64::INFINITY),
        )
    }

    /// Contact event of the nearest collider. `middle`: centre (m) of the contact point, at most `reach` (m) from the
    /// queried position.
    #[inline(always)]
    fn nearest(
        &self,
        middle: &Vector3<f64>,
        reach: f64,
        meet: impl Fn(&Collider) -> bool,
        query: impl Fn(&Collider) -> ContactEvent,
    ) -> ContactEvent {
        let mut best = ContactEvent::none(*middle);
        for (collider, body) in self.colliders.iter().enumerate() {
            if body.beyond(middle, best.distance + reach) || !meet(body) {
                continue;
            }
            let event = query(body);
            if event.distance < best.distance {
                best = ContactEvent { collider, ..event };
            }
        }
        best
    }

    /// Appends to `events` the contact events of a contact point with all colliders nearer than `reach` (m); `data` has
    /// the kinematics.
    ///
    /// Colliders that overlap or adjoin act as their union: a nearest surface point covered by a nearer collider is
    /// left out. A point inside several colliders is pushed out of each.
    pub fn meetings(
        &self,
        point: &ContactPoint,
        data: &Data,
        reach: f64,
        surfaces: &Surfaces,
        events: &mut Vec<ContactEvent>,
    ) {
        let middle = point_position(data, point.link, &point.local);
        let first = events.len();
        for (collider, body) in self.colliders.iter().enumerate() {
            if body.beyond(&middle, reach + point.reach()) || surfaces.meeting(point, body).is_none() {
                continue;
            }
            let event = body.meets(point, data, &middle, reach);
            // Keep NaN distances, so that solvers can report them.
            if event.distance < reach || event.distance.is_nan() {
                events.push(ContactEvent { collider, ..event });
            }
        }
        let found = events.len();
        if found - first < 2 {
            return;
        }
        for k in first..found {
            if !self.covered(&events[k], &events[first..found]) {
                events.push(events[k]);
            }
        }
        events.drain(first..found);
    }

    /// Whether a nearer collider covers the nearest surface point of an event with `p0` outside.
    fn covered(&self, event: &ContactEvent, others: &[ContactEvent]) -> bool {
        let nearer = |o: &&ContactEvent| (o.distance, o.collider) < (event.distance, event.collider);
        event.distance > 0.0
            && others
                .iter()
                .filter(nearer)
                .any(|o| self.colliders[o.collider].query(&event.p1).distance < MIN_COVERED_DEPTH)
    }

    /// Refuses values that are not finite or out of range. Solvers call this before they step.
    pub fn check(&self) -> Result<(), String> {
        if !self.gravity.iter().all(|g| g.is_finite()) {
            return Err(format!("scene `{}`: gravity {:?} is not finite (m/s^2)", self.name, self.gravity.as_slice()));
        }
        let wrong = |(k, body): (usize, &Collider)| {
            body.check().err().map(|e| format!("scene `{}`, collider {k}: {e}", self.name))
        };
        self.colliders.iter().enumerate().find_map(wrong).map_or(Ok(()), Err)
    }
}

/// The up direction: opposite to gravity, z without gravity.
pub fn up(gravity: &Vector3<f64>) -> Vector3<f64> {
    -gravity.try_normalize(0.0).unwrap_or_else(|| -Vector3::z())
}

/// Centres of a robot's contact points at a state (m, world).
pub fn points(robot: &Robot, state: &[f64]) -> Vec<Vector3<f64>> {
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    robot.contact_points.iter().map(|point| point_position(&data, point.link, &point.local)).collect()
}

/// Position (m, world) of a contact point against a plane surface with unit `normal`; `data` has the kinematics.
pub fn place(point: &ContactPoint, data: &Data, normal: &Vector3<f64>) -> Vector3<f64> {
    point_position(data, point.link, &point.facing(&data.rotation[point.link], normal))
}

/// Height (m) along unit `up` of the lowest point of a contact point's surface; `data` has the kinematics.
pub fn foot(point: &ContactPoint, data: &Data, up: &Vector3<f64>) -> f64 {
    up.dot(&place(point, data, up)) - point.radius
}

/// Name of the scene from a robot's own file.
pub const GROUND: &str = "ground";
