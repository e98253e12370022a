//! Materials of a system's contacts with the scene and with itself, contact events, and energy stored in springs.

use crate::internal::*;
use crate::scene::Meeting;

impl System {
    /// Energy (J) stored in the springs of contacts, joints and joint limits. A spring with stiffness k (N/m or N
    /// m/rad) and deflection g (m or rad) stores `k g^2 / 2`.
    pub fn stored(&self, scene: &Scene, state: &[f64], data: &mut Data) -> f64 {
        let robot = &self.robot;
        let mut events = Vec::new();
        contacts(self, scene, state, data, &mut events);
        let near = robot.contact_points.iter().zip(&events).filter(|(_, event)| event.distance.is_finite());
        let pressed = near.filter_map(|(point, event)| {
            let material = self.meeting(point, &scene.colliders[event.collider])?;
            Some(0.5 * material.stiffness * (event.distance - point.radius - material.margin).min(0.0).powi(2))
        });
        let joints = || state[robot.root_coords()..].iter().zip(robot.joints());
        let bent =
            joints().filter_map(|(q, j)| j.limit.map(|l| 0.5 * l.stiffness * (q - q.clamp(l.lower, l.upper)).powi(2)));
        let sprung = joints().map(|(q, j)| 0.5 * j.stiffness * (q - j.rest).powi(2));
        pressed.sum::<f64>() + bent.sum::<f64>() + sprung.sum::<f64>()
    }

    /// Material of a contact point on a collider; `None` if the two never collide.
    #[inline]
    pub fn meeting(&self, point: &ContactPoint, collider: &Collider) -> Option<Material> {
        let material = collider.material.mean(&self.spec.material);
        match self.surfaces.meeting(point, collider)? {
            Meeting::Plain => Some(material),
            Meeting::Law(law) => Some(material.by(law, collider, self.one_friction)),
        }
    }

    /// Material of the k-th pair of self-colliding parts.
    pub(crate) fn folding(&self, k: usize) -> Material {
        let own = &self.spec.material;
        self.folds.laws[k]
            .map_or(*own, |law| own.pair(&law, self.one_friction.filter(|_| law.condim > 1).unwrap_or(law.friction)))
    }
}

/// Writes the contact event of every contact point of a robot at `state` into `events`. Also leaves the robot's
/// kinematics at `state` in `data`.
pub fn contacts(system: &System, scene: &Scene, state: &[f64], data: &mut Data, events: &mut Vec<ContactEvent>) {
    let robot = &system.robot;
    kinematics(robot, state, data);
    events.clear();
    events.extend(robot.contact_points.iter().map(|point| scene.meets(point, data, &system.surfaces)));
}
