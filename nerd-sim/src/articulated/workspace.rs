//! Working memory of a frame, and the contact events in it.

use nerd_core::dynamics::{Factor, velocities};

use super::stiff::{Bounds, Stiff};
use super::{kept::Kept, memory::Memory, touches::Touches};
use crate::prelude::*;
use crate::scene::Meeting;

/// The materials with which a robot meets the colliders of a scene.
#[derive(Default)]
pub(super) struct Materials {
    /// By collider, the mean of both.
    means: Vec<Material>,
    /// Largest margin of what the file says (m).
    pub(super) margin: f64,
}

impl Materials {
    pub(super) fn begin(&mut self, system: &System, scene: &Scene) {
        self.means.clear();
        self.means.extend(scene.colliders.iter().map(|c| c.material.mean(&system.spec.material)));
        let means = self.means.iter().map(|m| m.margin).fold(0.0, f64::max);
        self.margin = if system.surfaces.is_empty() { means } else { means.max(system.margin) };
    }

    pub(super) fn clear(&mut self) {
        self.means.clear();
    }

    pub(super) fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// That of a contact point and a collider, the k-th; none if they never meet.
    #[inline]
    pub(super) fn of(&self, system: &System, point: &ContactPoint, collider: &Collider, k: usize) -> Option<Material> {
        let mean = self.means[k];
        Some(match system.surfaces.meeting(point, collider)? {
            Meeting::Plain => mean,
            Meeting::Law(law) => mean.by(law, collider, system.one_friction),
        })
    }
}

/// Working memory of one environment at a time; nothing in it outlives a frame.
pub(super) struct Workspace {
    pub(super) data: Data,
    pub(super) factor: Factor,
    pub(super) materials: Materials,
    /// Contact events, and the point of each.
    pub(super) events: Vec<ContactEvent>,
    pub(super) owners: Vec<usize>,
    pub(super) touches: Touches,
    pub(super) stiff: Stiff,
    /// The substep (s) that the frame began with, before its energy asked for shorter ones.
    pub(super) whole: f64,
    /// Drives of the joints; empty: none.
    pub(super) drives: Vec<Drive>,
    /// Whether they are those of servos, and the torques that these leave to be held.
    pub(super) servo: bool,
    pub(super) rest: Vec<f64>,
    /// Mean force (N) on each contact point in the frame, world axes.
    pub(super) forces: Vec<Vector3<f64>>,
    /// Of the explicit integrators.
    pub(super) rates: [Vec<f64>; 4],
    pub(super) trial: Vec<f64>,
    pub(super) start: Vec<f64>,
    /// Change of a drag that asks for no other solve, and solves at most, of this frame.
    pub(super) settling: (f64, usize),
    /// What the frame did, while it is to be gone back.
    pub(super) kept: Option<Kept>,
    /// Of the way back, once that was asked for.
    pub(super) back: Option<Box<Memory>>,
}

impl Workspace {
    pub(super) fn of(system: &System, bounds: Arc<Bounds>) -> Self {
        let robot = &system.robot;
        let d = robot.state_dim();
        Self {
            data: system.data(),
            factor: Factor::new(robot),
            rates: std::array::from_fn(|_| vec![0.0; d]),
            trial: vec![0.0; d],
            start: vec![0.0; d],
            materials: Materials::default(),
            events: Vec::new(),
            owners: Vec::new(),
            touches: Touches::new(system),
            stiff: Stiff::new(robot, bounds),
            whole: 0.0,
            drives: Vec::new(),
            servo: false,
            rest: Vec::new(),
            settling: (0.0, 0),
            kept: None,
            back: None,
            forces: vec![Vector3::zeros(); robot.contact_points.len()],
        }
    }

    /// Contact events of all points with every collider that they may touch within a time (s) at their present velocity,
    /// or nearer than `margin` (m).
    pub(super) fn query(&mut self, system: &System, scene: &Scene, qd: &[f64], time: f64, margin: f64) -> Result<(), String> {
        let robot = &system.robot;
        self.events.clear();
        if let [only] = &scene.colliders[..] {
            // It is looked at wherever it is, by every point in turn. Of a plane its normal is all that is asked for, so the middle of where
            // a point may be is as good as the point.
            let flat = only.plane.is_some();
            for point in &robot.contact_points {
                let middle = point_position(&self.data, point.link, &point.local);
                // One push each: an event that comes from either is copied by way of the stack, at a tenth of a substep.
                if flat || point.locus.is_fixed() {
                    self.events.push(only.query(&middle));
                } else {
                    self.events.push(only.search(point, &self.data, &middle, f64::INFINITY));
                }
            }
        } else {
            velocities(robot, qd, &mut self.data);
            self.owners.clear();
            for (index, point) in robot.contact_points.iter().enumerate() {
                let middle = point_position(&self.data, point.link, &point.local);
                let twist = &self.data.velocity[point.link];
                let speed = twist.at(&(middle - self.data.origin)).norm() + twist.ang.norm() * point.reach();
                let reach = point.radius + self.materials.margin + margin + time * speed;
                scene.meetings(point, &self.data, reach, &system.surfaces, &mut self.events);
                self.owners.resize(self.events.len(), index);
            }
        }
        let lost = self.events.iter().any(|e| e.distance.is_nan());
        if lost { Err(self.lost(robot, scene)) } else { Ok(()) }
    }

    /// Names the contact point and the collider between which there is no distance.
    #[cold]
    fn lost(&self, robot: &Robot, scene: &Scene) -> String {
        let found = self.events.iter().zip(&self.owners).find(|(e, _)| e.distance.is_nan());
        let (collider, index) = found.map_or((0, 0), |(event, index)| (event.collider, *index));
        let link = &robot.links[robot.contact_points[index].link].name;
        format!(
            "the distance of contact point {index} on link `{link}` to collider {collider} of scene `{}` is not a number: the state or the collider is not finite",
            scene.name
        )
    }
}
