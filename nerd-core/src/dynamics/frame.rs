//! A frame's pose and velocity, along the chain of links that carries it: nothing else of the robot is looked at, nothing allocated.

use nalgebra::Rotation3;

use super::kinematics::{hung, root_rotation};
use crate::{prelude::*, velocity::root_position};

impl Robot {
    /// Where a frame ([`Robot::frame`]) is in the world at coordinates `q`.
    pub fn pose(&self, q: &[f64], frame: &FixedFrame) -> Isometry3<f64> {
        let carrier = match (frame.link, self.base) {
            (Some(link), _) => {
                let (rotation, position, _) = self.carried(q, None, link);
                let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
                Isometry3::from_parts((root_position(self, q) + position).into(), rotation)
            }
            (None, Base::Fixed(base)) => base,
            (None, Base::Floating) => Isometry3::identity(),
        };
        carrier * frame.pose
    }

    /// Angular velocity (rad/s) of a frame and velocity (m/s) of its origin, world axes.
    pub fn velocity(&self, q: &[f64], qd: &LocalVelocity<impl AsRef<[f64]>>, frame: &FixedFrame) -> Motion {
        let Some(link) = frame.link else { return Motion::default() };
        let (rotation, position, twist) = self.carried(q, Some(qd.0.as_ref()), link);
        Motion::new(twist.ang, twist.at(&(position + rotation * frame.pose.translation.vector)))
    }

    /// Rotation, place and twist of a link, from and about the root.
    fn carried(&self, q: &[f64], qd: Option<&[f64]>, link: usize) -> (Matrix3<f64>, Vector3<f64>, Motion) {
        let Some(joint) = &self.links[link].joint else {
            return (root_rotation(self, q), Vector3::zeros(), qd.map_or(Motion::default(), Motion::from_slice));
        };
        let (parent, start, twist) = match self.links[link].parent {
            Some(parent) => self.carried(q, qd, parent),
            None => (root_rotation(self, q), Vector3::zeros(), Motion::default()),
        };
        let coordinate = joint.mimic().map_or_else(|| self.coordinate(link), |m| m.coordinate);
        let own = q[self.root_coords() + coordinate];
        let value = joint.mimic().map_or(own, |m| m.multiplier * own + m.offset);
        let mut axis = Motion::default();
        let (rotation, position) = hung(joint, value, &parent, start, &mut axis);
        (rotation, position, qd.map_or(twist, |qd| twist + axis * qd[self.root_dofs() + coordinate]))
    }

    /// The place, among the joints that move by themselves, of the one that carries a link.
    fn coordinate(&self, link: usize) -> usize {
        let first = usize::from(self.floating());
        if !self.mimics() {
            return link - first;
        }
        self.links[first..link].iter().filter(|l| l.joint.as_ref().is_some_and(|j| j.mimic().is_none())).count()
    }
}
