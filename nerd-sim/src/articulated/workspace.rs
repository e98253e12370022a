//! Working memory of a frame, and its contact queries.

use nerd_core::dynamics::{Factor, velocities};

use super::stiff::{Bounds, Stiff};
use super::{kept::Kept, memory::Memory, touches::Touches};
use crate::prelude::*;
use crate::scene::Meeting;

/// Materials of a robot's contacts with the colliders of a scene.
#[derive(Default)]
pub(super) struct Materials {
    /// By collider: mean of its material and the robot's.
    means: Vec<Material>,
    /// Largest contact margin of any pair (m).
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

    /// Material of a contact point on the k-th collider; `None` if point and collider never meet.
    #[inline]
    pub(super) fn of(&self, system: &System, point: &ContactPoint, collider: &Collider, k: usize) -> Option<Material> {
        let mean = self.means[k];
        Some(match system.surfaces.meeting(point, collider)? {
            Meeting::Plain => mean,
            Meeting::Law(law) => mean.by(law, collider, system.one_friction),
        })
    }
}

/// Working memory of one environment at a time; nothing survives a frame.
pub(super) struct Workspace {
    pub(super) data: Data,
    pub(super) factor: Factor,
    pub(super) materials: Materials,
    /// Contact events, and the contact point of each.
    pub(super) events: Vec<ContactEvent>,
    pub(super) owners: Vec<usize>,
    pub(super) touches: Touches,
    pub(super) stiff: Stiff,
    /// Substep (s) of the frame's first attempt, before the energy watch shortens it.
    pub(super) first_h: f64,
    /// Drives of the joints; empty: none.
    pub(super) drives: Vec<Drive>,
    /// Whether `drives` are servos, computed from the frame's torques.
    pub(super) servo: bool,
    /// Torques (N m) of joints without servo gains, constant over the frame.
    pub(super) rest: Vec<f64>,
    /// Mean force (N) on each contact point in the frame, world axes.
    pub(super) forces: Vec<Vector3<f64>>,
    /// Working memory of the explicit integrators.
    pub(super) rates: [Vec<f64>; 4],
    pub(super) trial: Vec<f64>,
    pub(super) start: Vec<f64>,
    /// Tolerance on the relative change of a drag between two solves, and the most solves of a substep.
    pub(super) settling: (f64, usize),
    /// Record of the frame, when its gradient is wanted.
    pub(super) kept: Option<Kept>,
    /// Working memory of the backward pass, once requested.
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
            first_h: 0.0,
            drives: Vec::new(),
            servo: false,
            rest: Vec::new(),
            settling: (0.0, 0),
            kept: None,
            back: None,
            forces: vec![Vector3::zeros(); robot.contact_points.len()],
        }
    }

    /// Contact events of every point with every collider within `margin` (m) plus the distance covered in `time` (s) at
    /// the point's present velocity.
    pub(super) fn query(
        &mut self,
        system: &System,
        scene: &Scene,
        qd: &[f64],
        time: f64,
        margin: f64,
    ) -> Result<(), String> {
        let robot = &system.robot;
        self.events.clear();
        if let [only] = &scene.colliders[..] {
            // A single collider is queried at any distance. Of a plane only the normal is used, so the middle of a
            // point's locus serves.
            let flat = only.plane.is_some();
            for point in &robot.contact_points {
                let middle = point_position(&self.data, point.link, &point.local);
                // One push per branch: a common push copies the event over the stack, which takes a tenth of a
                // substep's time.
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

    /// Error text that names the contact point and the collider whose distance is NaN.
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
