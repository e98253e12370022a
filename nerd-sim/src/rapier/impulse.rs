//! The same robot on impulse joints: every link six DoFs, held together by rapier's constraint solver. For comparison:
//! joints drift apart and there is no armature. Damping and limits act as torques, once an outer step.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Vector3};
use nerd_core::dynamics::{kinematics, link_pose, velocities};
use nerd_core::robot::{Base, Joint, JointKind, Robot};
use rapier3d_f64::prelude::RigidBody;

use super::frame::Workspace;
use crate::scene::{from_parry, pose_from_parry, pose_to_parry, to_parry};

impl Workspace {
    /// Puts every body where (q, qd), velocities local, has its link.
    pub(super) fn place_bodies(&mut self, robot: &Robot, q: &[f64], qd: &[f64]) -> Result<(), String> {
        kinematics(robot, q, &mut self.data);
        velocities(robot, qd, &mut self.data);
        self.seen.copy_from_slice(&q[robot.root_coords()..]);
        for (i, link) in robot.links.iter().enumerate() {
            let mut pose = link_pose(&self.data, i);
            if robot.floating() && i == 0 {
                pose *= Isometry3::from(self.template.root_com);
            }
            let com = self.data.position[i] + self.data.rotation[i] * link.inertia.com;
            let twist = self.data.velocity[i];
            let body = self.world.bodies.get_mut(self.template.links[i]).ok_or("no body")?;
            body.set_position(pose_to_parry(&pose), false);
            body.set_linvel(to_parry(&twist.at(&com)), false);
            body.set_angvel(to_parry(&twist.ang), false);
        }
        Ok(())
    }

    /// Position and velocity of the joint of link `i`; of the two bodies' relative motion that along or about its axis.
    fn joint(&self, robot: &Robot, i: usize, joint: &Joint) -> Option<[f64; 2]> {
        let body = |link: usize| self.world.bodies.get(self.template.links[link]);
        let child = body(i)?;
        let (parent_pose, parent) = match (robot.links[i].parent, &robot.base) {
            (Some(p), _) => {
                let shift = if robot.floating() && p == 0 { -self.template.root_com } else { Vector3::zeros() };
                (pose_from_parry(body(p)?.position()) * Isometry3::from(shift), body(p))
            }
            (None, Base::Fixed(pose)) => (*pose, None),
            (None, Base::Floating) => return None,
        };
        let child_pose = pose_from_parry(child.position());
        let moved = (parent_pose * joint.origin()).inverse() * child_pose;
        let axis = child_pose.rotation * joint.axis().into_inner();
        let at = child_pose.translation.vector;
        let speed = |body: &RigidBody, at: &Vector3<f64>| from_parry(&body.velocity_at_point(to_parry(at)));
        Some(match joint.kind {
            JointKind::Prismatic => {
                let along = speed(child, &at) - parent.map_or(Vector3::zeros(), |p| speed(p, &at));
                [joint.axis().dot(&moved.translation.vector), axis.dot(&along)]
            }
            _ => {
                let turn = moved.rotation.quaternion();
                let angle = 2.0 * joint.axis().dot(&turn.imag()).atan2(turn.w);
                let spin = from_parry(&child.angvel()) - parent.map_or(Vector3::zeros(), |p| from_parry(&p.angvel()));
                [nerd_core::state::wrap(angle), axis.dot(&spin)]
            }
        })
    }

    /// Torque of limit, spring and damping at the joint of link `i` now.
    pub(super) fn passive(&mut self, robot: &Robot, i: usize) -> f64 {
        let Some(([q, qd], joint)) = self.turned(robot, i).zip(robot.links[i].joint.as_ref()) else { return 0.0 };
        joint.limit.map_or(0.0, |l| l.force(q, qd)) + joint.stiffness * (joint.rest - q) - joint.damping * qd
    }

    /// Position and velocity of the joint of link `i`; of the angles of one pose the one nearest to the last seen.
    fn turned(&mut self, robot: &Robot, i: usize) -> Option<[f64; 2]> {
        let joint = robot.links[i].joint.as_ref()?;
        let [x, v] = self.joint(robot, i, joint)?;
        let last = &mut self.seen[i - usize::from(robot.floating())];
        let turns = if joint.kind == JointKind::Prismatic { 0.0 } else { ((*last - x) / TAU).round() };
        *last = x + turns * TAU;
        Some([*last, v])
    }

    /// Takes the joints back.
    pub(super) fn read_joints(&mut self, robot: &Robot, q: &mut [f64], qd: &mut [f64]) -> Result<(), String> {
        let (dofs, coords, first) = (robot.root_dofs(), robot.root_coords(), usize::from(robot.floating()));
        for i in first..robot.links.len() {
            let k = i - first;
            [q[coords + k], qd[dofs + k]] = self.turned(robot, i).ok_or("no body")?;
        }
        Ok(())
    }
}
