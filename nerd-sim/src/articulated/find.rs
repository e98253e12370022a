//! Collects the touches of an implicit substep: contacts, dry friction, drives, joints beyond their limits.

use nerd_core::dynamics::velocities;

use super::touch::{Contact, DryFriction, Spring, Touch, inside, part_of};
use super::turning::{Turning, gyration};
use super::{touches::Touches, workspace::Workspace};
use crate::prelude::*;

impl Workspace {
    /// Finds all points and joints that are beyond their surface or limit during any part of the substep. Needs pose
    /// and kinematics at the substep's middle.
    pub(super) fn find(&mut self, system: &System, scene: &Scene, q: &[f64], qd: &[f64], h: f64) {
        let robot = &system.robot;
        velocities(robot, qd, &mut self.data);
        self.touches.touches.clear();
        self.touches.columns.clear();
        self.find_contacts(system, scene, h);
        self.find_friction(robot, qd);
        let pairs = robot.contact_points.len() * scene.colliders.len();
        self.find_drives(robot, pairs, q, qd);
        self.find_limits(robot, pairs, q, qd, h);
    }

    /// Finds the contacts among the substep's contact events.
    fn find_contacts(&mut self, system: &System, scene: &Scene, h: f64) {
        let robot = &system.robot;
        let materials = &self.materials;
        let data = &self.data;
        // Below this gap (m) gravity may land a point within the substep, although its present velocity would not.
        let fall = h * h * scene.gravity.norm();
        let Touches { touches, columns, tree, may_gain_energy, .. } = &mut self.touches;
        for (owner, event) in self.owners.iter().zip(&self.events) {
            let point = &robot.contact_points[*owner];
            let n = event.normal;
            let Some(whole) = materials.of(system, point, &scene.colliders[event.collider], event.collider) else {
                continue;
            };
            let Some(local) = place(point, data, event, whole.margin + fall, 0.5 * h) else { continue };
            let x = data.position[point.link] + data.rotation[point.link] * local - n * point.radius;
            let velocity = data.velocity[point.link].at(&x);
            let middle = n.dot(&(x - (event.p1 - data.origin))) - whole.margin;
            let way = 0.5 * h * n.dot(&velocity);
            let Some((part, gap)) = inside(middle, way) else {
                *may_gain_energy |= middle - way.abs() < fall;
                continue;
            };
            *may_gain_energy |= !point.locus.is_fixed();
            let turning = turning(robot, data, point.link, &whole);
            let start = columns.len();
            if tree.is_none() {
                above(robot, data, point.link, &x, columns);
            }
            touches.push(Touch::Contact(Contact {
                index: owner * scene.colliders.len() + event.collider,
                point: *owner,
                link: point.link,
                x,
                columns: start..columns.len(),
                material: part_of(&whole, part),
                whole,
                normal: n,
                middle,
                gap,
                velocity,
                start: velocity,
                turn: Vector3::zeros(),
                theta: [0.0; 3],
                dampers: [[0.0; 2]; 2],
                drag: 0.0,
                slip_offset: Vector3::zeros(),
                slip_offset_start: Vector3::zeros(),
                turning,
                parted: false,
                creeps: false,
                force: Vector3::zeros(),
            }));
        }
    }

    /// Finds the joints with dry friction.
    fn find_friction(&mut self, robot: &Robot, qd: &[f64]) {
        let touches = &mut self.touches.touches;
        let dofs = robot.root_dofs();
        for (joint, friction) in robot.joints().map(|j| j.friction).enumerate().filter(|(_, friction)| *friction > 0.0)
        {
            touches.push(Touch::Friction(DryFriction { joint, most: friction, rate: qd[dofs + joint], drag: 0.0 }));
        }
    }

    /// Finds the drives; `pairs`: number of pairs of point and collider.
    fn find_drives(&mut self, robot: &Robot, pairs: usize, q: &[f64], qd: &[f64]) {
        let touches = &mut self.touches.touches;
        let dofs = robot.root_dofs();
        let joints = robot.joint_count();
        for ((joint, modelled), drive) in robot.joints().enumerate().zip(&self.drives) {
            let (x, v) = (q[robot.root_coords() + joint], qd[dofs + joint]);
            let spring = Spring {
                index: pairs + joints + joint,
                joint,
                side: 1.0,
                stiffness: drive.kp,
                damping: drive.kd,
                middle: x - drive.target,
                gap: x - drive.target,
                rate: v - drive.speed,
                theta: [0.0; 2],
            };
            touches.push(Touch::Drive { spring, bounds: drive.bounds(modelled, v), held: None });
        }
    }

    /// Finds the joints beyond a limit, and sets the torques of springs; `pairs` as in [`Self::find_drives`].
    fn find_limits(&mut self, robot: &Robot, pairs: usize, q: &[f64], qd: &[f64], h: f64) {
        let Touches { touches, pull, .. } = &mut self.touches;
        let dofs = robot.root_dofs();
        for (joint, modelled) in robot.joints().enumerate() {
            let x = q[robot.root_coords() + joint];
            pull[joint] = modelled.stiffness * (modelled.rest - x);
            let Some(limit) = modelled.limit.filter(|l| l.stiffness > 0.0 || l.damping > 0.0) else { continue };
            for (end, side) in [(limit.lower, 1.0), (limit.upper, -1.0)] {
                let rate = side * qd[dofs + joint];
                let middle = side * (x - end);
                let Some((part, gap)) = inside(middle, 0.5 * h * rate) else { continue };
                let (stiffness, damping) = (part * limit.stiffness, part * limit.damping);
                let theta = [0.0; 2];
                touches.push(Touch::Limit(Spring {
                    index: pairs + joint,
                    joint,
                    side,
                    stiffness,
                    damping,
                    middle,
                    gap,
                    rate,
                    theta,
                }));
            }
        }
    }
}

/// Place (m) of a contact point in its link's frame. `None` if its locus moves and stays farther than `margin` (m) from
/// the surface over `time` (s).
fn place(point: &ContactPoint, data: &Data, event: &ContactEvent, margin: f64, time: f64) -> Option<Vector3<f64>> {
    match point.locus {
        Locus::Fixed => Some(point.local),
        _ => roams(point, data, event, margin, time),
    }
}

/// Angular velocity and squared radius of gyration of a link whose material has torsional or rolling friction; else
/// zeros.
fn turning(robot: &Robot, data: &Data, link: usize, material: &Material) -> Turning {
    let mut turning = Turning::default();
    if material.torsion > 0.0 || material.rolling > 0.0 {
        (turning.spin, turning.gyration) = (data.velocity[link].ang, gyration(&robot.links[link]));
    }
    turning
}

/// Appends the columns of the Jacobian of a link's point `x` (m, from `data.origin`), each with its DoF.
#[inline]
pub(super) fn above(
    robot: &Robot,
    data: &Data,
    link: usize,
    x: &Vector3<f64>,
    columns: &mut Vec<(usize, Vector3<f64>)>,
) {
    for i in robot.ancestors(link) {
        if robot.links[i].joint.is_some() {
            columns.push((data.dof[i], data.axis[i].at(x)));
        } else {
            for k in 0..3 {
                columns.push((k, Vector3::ith(k, 1.0).cross(x)));
                columns.push((3 + k, Vector3::ith(k, 1.0)));
            }
        }
    }
}

/// Place (m) in the link's frame of a contact point with a moving locus. `None` if no place of the locus comes within
/// `margin` (m) of the surface over `half` a substep (s).
#[inline(never)]
fn roams(point: &ContactPoint, data: &Data, event: &ContactEvent, margin: f64, half: f64) -> Option<Vector3<f64>> {
    let rotation = &data.rotation[point.link];
    let twist = &data.velocity[point.link];
    let n = &event.normal;
    let reach = point.reach();
    let middle = data.position[point.link] + rotation * point.local;
    let speed = twist.at(&middle).norm() + twist.ang.norm() * reach;
    let comes = n.dot(&(middle - (event.p1 - data.origin))) - reach - point.radius - margin <= half * speed;
    comes.then(|| point.facing(rotation, n))
}
