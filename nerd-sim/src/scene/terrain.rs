//! Uneven ground around robots: its height, and start positions on it.

use crate::{internal::*, scene::foot, scene::place};

use super::{Collider, Field};

impl Scene {
    /// The uneven ground that repeats, if the scene has one.
    pub fn terrain(&self) -> Option<(&Collider, &Field)> {
        self.colliders.iter().find_map(|body| Some((body, body.field.as_ref().filter(|field| field.repeats())?)))
    }

    /// Whether the scene has any height field.
    pub fn uneven(&self) -> bool {
        self.colliders.iter().any(|body| body.field.is_some())
    }

    /// The scene with the heights of its repeating ground multiplied by `scale`.
    #[must_use]
    pub fn scaled(&self, scale: f64) -> Self {
        let mut own = self.clone();
        let fields = own.colliders.iter_mut().filter_map(|body| body.field.as_mut());
        fields.filter(|field| field.repeats()).for_each(|field| *field = field.scaled(scale));
        own
    }

    /// Height (m, along the up axis) of repeating uneven ground at a point near a free root. The point lies `ahead` (m)
    /// of the root along its heading, and `aside` (m) to the left.
    pub fn ground(&self, state: &[f64], [ahead, aside]: [f64; 2]) -> Option<f64> {
        let (body, field) = self.terrain()?;
        let at = body.inside(&vector(&state[..3]));
        let along = body.pose.rotation.inverse_transform_vector(&(quaternion(&state[3..7]) * Vector3::x()));
        let length = along.x.hypot(along.y);
        let [c, s] = if length > 1e-9 { [along.x / length, along.y / length] } else { [1.0, 0.0] };
        let (height, _) = field.at(at.x + c * ahead - s * aside, at.y + s * ahead + c * aside);
        Some(body.up().dot(&body.pose.translation.vector) + height)
    }

    /// Moves the start of a free root to a random position on uneven ground; its lowest point keeps its height above
    /// the ground. On flat ground nothing changes and nothing is drawn.
    pub fn strew(&self, robot: &Robot, data: &mut Data, state: &mut [f64], rng: &mut impl Rng) {
        let Some((body, field)) = self.terrain().filter(|_| robot.floating()) else { return };
        let up = body.up();
        let nq = robot.nq();
        let [wide, deep] = field.period();
        let mut shift = |by: Vector3<f64>, state: &mut [f64]| {
            let turning = by.cross(&vector(&state[nq..nq + 3]));
            (0..3).for_each(|k| state[k] += by[k]);
            // The root's twist is about the world origin, so the linear part changes with position.
            (0..3).for_each(|k| state[nq + 3 + k] += turning[k]);
            kinematics(robot, state, data);
            let over = |point: &ContactPoint| {
                let event = body.query(&place(point, data, &up));
                (foot(point, data, &up), (event.distance - point.radius) / event.normal.dot(&up))
            };
            let least = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.min(b.1));
            robot.contact_points.iter().map(over).reduce(least)
        };
        let Some((low, _)) = shift(Vector3::zeros(), state) else { return };
        let (x, y) = (wide * rng.random::<f64>(), deep * rng.random::<f64>());
        let Some((_, above)) = shift(body.pose.rotation * Vector3::new(x, y, 0.0), state) else { return };
        shift(up * (low - up.dot(&body.pose.translation.vector) - above), state);
    }
}
