//! Everything that is not the robot: gravity and static colliders.

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
#[cfg(feature = "rapier")]
pub(crate) use parry::pose_from_parry;
pub(crate) use parry::{from_parry, pose_to_parry, to_parry};
pub(crate) use spec::is_zero;
pub use spec::{BoxSpec, Material, PegSpec, PlaneSpec, SceneSpec};
pub use surfaces::{Meeting, PairLaw, Softness, SurfaceGeom, Surfaces};
pub use worlds::{WORLDS, hill, world};
pub(crate) use worlds::{described, flat, peg};

/// Default gravity (m/s^2).
pub const GRAVITY: f64 = 9.81;

/// Thickness (m) of what covers a surface, beyond rounding.
const SKIN: f64 = 1e-6;

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
    /// Nothing but gravity.
    pub fn free(gravity: Vector3<f64>) -> Self {
        Self { name: "free".into(), gravity, colliders: Vec::new() }
    }

    /// The nearest collider's event for the world point `p0`.
    #[inline]
    pub fn contact(&self, p0: &Vector3<f64>) -> ContactEvent {
        self.nearest(p0, 0.0, |_| true, |body| body.query(p0))
    }

    /// The nearest collider's event for a contact point of a robot whose kinematics are in `data`.
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

    /// `middle` is at most `reach` (m) from where the query is made.
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

    /// Every event that acts on a point at `p0`, of the colliders nearer than `reach` (m), onto `events`.
    ///
    /// Where colliders overlap or lie side by side the surface is that of their union: a place of a surface that a nearer
    /// collider covers is no surface, and its event is left out. But a point inside several colliders is pushed out of each.
    pub fn contacts_at(&self, p0: &Vector3<f64>, reach: f64, events: &mut Vec<ContactEvent>) {
        self.gather(p0, [reach; 2], |_| true, |body| body.query(p0), events);
    }

    /// The same for a contact point of a robot whose kinematics are in `data`.
    pub fn meetings(&self, point: &ContactPoint, data: &Data, reach: f64, surfaces: &Surfaces, events: &mut Vec<ContactEvent>) {
        let middle = point_position(data, point.link, &point.local);
        let meet = |body: &Collider| surfaces.meeting(point, body).is_some();
        self.gather(&middle, [reach, reach + point.reach()], meet, |body| body.meets(point, data, &middle, reach), events);
    }

    #[inline(always)]
    fn gather(
        &self,
        middle: &Vector3<f64>,
        [reach, wide]: [f64; 2],
        meet: impl Fn(&Collider) -> bool,
        query: impl Fn(&Collider) -> ContactEvent,
        events: &mut Vec<ContactEvent>,
    ) {
        let first = events.len();
        for (collider, body) in self.colliders.iter().enumerate() {
            if body.beyond(middle, wide) || !meet(body) {
                continue;
            }
            let event = query(body);
            // NaNs are found, too, so that they can be reported.
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

    /// Whether the nearest place of a collider that `p0` is outside of is covered by a nearer one of `others`.
    fn covered(&self, event: &ContactEvent, others: &[ContactEvent]) -> bool {
        let nearer = |o: &&ContactEvent| (o.distance, o.collider) < (event.distance, event.collider);
        event.distance > 0.0 && others.iter().filter(nearer).any(|o| self.colliders[o.collider].query(&event.p1).distance < SKIN)
    }

    /// Says what is not finite or out of its range, if anything is. Solvers ask before they step.
    pub fn check(&self) -> Result<(), String> {
        if !self.gravity.iter().all(|g| g.is_finite()) {
            return Err(format!("scene `{}`: gravity {:?} is not finite (m/s^2)", self.name, self.gravity.as_slice()));
        }
        let wrong = |(k, body): (usize, &Collider)| body.check().err().map(|e| format!("scene `{}`, collider {k}: {e}", self.name));
        self.colliders.iter().enumerate().find_map(wrong).map_or(Ok(()), Err)
    }
}

/// The up direction: against gravity, z where there is none.
pub(crate) fn up(gravity: &Vector3<f64>) -> Vector3<f64> {
    -gravity.try_normalize(0.0).unwrap_or_else(|| -Vector3::z())
}

/// Where the middles of a robot's contact points are at a state (m, world).
pub(crate) fn points(robot: &Robot, state: &[f64]) -> Vec<Vector3<f64>> {
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    robot.contact_points.iter().map(|point| point_position(&data, point.link, &point.local)).collect()
}

/// Where a contact point is (m, world) when it faces a surface of unit `normal`; `data` has the kinematics.
pub fn place(point: &ContactPoint, data: &Data, normal: &Vector3<f64>) -> Vector3<f64> {
    point_position(data, point.link, &point.facing(&data.rotation[point.link], normal))
}

/// The height (m) along unit `up` of the lowest place of a contact point's surface; `data` has the kinematics.
pub fn foot(point: &ContactPoint, data: &Data, up: &Vector3<f64>) -> f64 {
    up.dot(&place(point, data, up)) - point.radius
}

/// The scene of a robot's own file.
pub const GROUND: &str = "ground";
