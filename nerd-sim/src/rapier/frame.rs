//! Steps one environment by one frame in rapier.

use nalgebra::Vector3;
use rapier3d_f64::prelude::*;

use super::pairs::{Pairs, TURNS, turns};
use super::template::{Template, axis, insert_scene};
use crate::scene::{from_parry, pose_from_parry, pose_to_parry, to_parry};
use crate::{internal::*, solver::parallel::Frame};

/// A robot's template, and a world that is rebuilt in every frame.
pub(super) struct Workspace {
    template: Arc<Template>,
    world: PhysicsWorld,
    data: Data,
    factor: Factor,
    displacement: Vec<f64>,
}

impl Frame for Workspace {
    type Config = RapierConfig;
    type Prepared = Template;
    const CHUNK: usize = 8;

    fn prepare(system: &System) -> Result<Arc<Template>, String> {
        Template::new(system).map(Arc::new)
    }

    fn new(system: &System, template: Arc<Template>) -> Self {
        let robot = &system.robot;
        let data = system.data();
        let factor = Factor::new(robot);
        Self { template, world: PhysicsWorld::new(), data, factor, displacement: vec![0.0; robot.nv()] }
    }

    fn turn_to(&mut self, template: &Arc<Template>) {
        self.template.clone_from(template);
    }

    fn step(
        &mut self,
        system: &System,
        scene: &Scene,
        config: &RapierConfig,
        state: &mut [f64],
        tau: &[f64],
    ) -> Result<(), String> {
        let robot = &system.robot;
        let (q, qd) = state.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        self.check(robot, scene, q, qd)?;
        let own = config.own_axes && robot.floating();
        let turn = if own { quaternion(&q[3..7]).inverse() } else { UnitQuaternion::identity() };
        if own {
            turned(&turn, q, qd);
        }
        self.renew(scene, &turn, config, system.frame_time);
        self.place(robot, q, qd)?;
        for _ in 0..config.steps {
            self.drive(robot, tau)?;
            self.world.step_with_events(&Pairs { system, scene }, &());
            if !self.world.quarantine().is_empty() {
                return Err("rapier met a number that is not finite".into());
            }
        }
        self.read(robot, q, qd)?;
        if own {
            turned(&turn.inverse(), q, qd);
        }
        to_world(robot, q, qd);
        Ok(())
    }
}

impl Workspace {
    /// Refuses a mass matrix that is not positive definite, and forces that are not finite. rapier itself divides by
    /// zero and drops overflowing accelerations without an error.
    fn check(&mut self, robot: &Robot, scene: &Scene, q: &[f64], qd: &[f64]) -> Result<(), String> {
        if scene.uneven() {
            return Err(format!("scene `{}`: rapier does not know terrain; take `articulated`", scene.name));
        }
        if scene.colliders.iter().any(|body| turns(&body.material)) {
            return Err(format!("scene `{}`: {TURNS}", scene.name));
        }
        kinematics(robot, q, &mut self.data);
        crba(robot, &mut self.data);
        if !self.factor.refill(&self.data.mass) {
            return Err(self.factor.fault(robot));
        }
        bias(robot, qd, &scene.gravity, &mut self.data);
        if self.data.tau.iter().all(|x| x.is_finite()) {
            Ok(())
        } else {
            Err("the forces of the motion are not finite: a state out of bounds".into())
        }
    }

    /// Replaces the world by one that has never been stepped, rotated by `turn`.
    fn renew(&mut self, scene: &Scene, turn: &UnitQuaternion<f64>, config: &RapierConfig, frame_time: f64) {
        let Template { bodies, colliders, joints, .. } = &*self.template;
        self.world = PhysicsWorld {
            gravity: to_parry(&(turn * scene.gravity)),
            integration_parameters: config.parameters(frame_time),
            bodies: bodies.clone(),
            colliders: colliders.clone(),
            multibody_joints: joints.clone(),
            ..PhysicsWorld::new()
        };
        insert_scene(scene, turn, config.restitution, &mut self.world.colliders);
    }

    /// The multibody and its rigid bodies.
    fn multibody(&mut self) -> Option<(&mut Multibody, &mut RigidBodySet)> {
        let multibody = self.world.multibody_joints.get_multibody_mut(self.template.multibody?)?;
        Some((multibody, &mut self.world.bodies))
    }

    /// Sets the robot's state (q, qd), with local velocities.
    fn place(&mut self, robot: &Robot, q: &[f64], qd: &[f64]) -> Result<(), String> {
        let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
        let com = self.template.root_com;
        let mut spin = Vector3::zeros();
        let mut speed = Vector3::zeros();
        if robot.floating() {
            let pose = Isometry3::from_parts(vector(&q[..3]).into(), quaternion(&q[3..7]));
            spin = vector(&qd[..3]);
            speed = vector(&qd[3..6]) + spin.cross(&(pose.rotation * com));
            let root = self.world.bodies.get_mut(self.template.links[0]).ok_or("no root")?;
            root.set_position(pose_to_parry(&(pose * Isometry3::translation(com.x, com.y, com.z))), false);
            if self.template.multibody.is_none() {
                root.set_linvel(to_parry(&speed), false);
                root.set_angvel(to_parry(&spin), false);
            }
        }
        let mut displacement = std::mem::take(&mut self.displacement);
        displacement[dofs..].copy_from_slice(&q[coords..]);
        if let Some((multibody, bodies)) = self.multibody() {
            multibody.apply_displacements(&displacement);
            let mut velocity = multibody.generalized_velocity_mut();
            if robot.floating() {
                velocity.rows_mut(0, 3).copy_from(&speed);
                velocity.rows_mut(3, 3).copy_from(&spin);
            }
            velocity.as_mut_slice()[dofs..].copy_from_slice(&qd[dofs..]);
            multibody.forward_kinematics(bodies, true);
            multibody.update_rigid_bodies(bodies, true);
        }
        self.displacement = displacement;
        Ok(())
    }

    /// Applies joint torques for one outer step, as opposite torques (forces on a slide) on the two bodies. Violated
    /// limits act as rapier's implicit spring and damper, which is the law of [`nerd_core::robot::Limit`].
    fn drive(&mut self, robot: &Robot, tau: &[f64]) -> Result<(), String> {
        let first = usize::from(robot.floating());
        for handle in &self.template.links {
            let body = self.world.bodies.get_mut(*handle).ok_or("no body")?;
            body.reset_forces(false);
            body.reset_torques(false);
        }
        for (i, link) in robot.links.iter().enumerate().skip(first) {
            let Some(joint) = &link.joint else { continue };
            let effort = tau[i - first];
            if effort == 0.0 {
                continue;
            }
            let child = self.world.bodies.get_mut(self.template.links[i]).ok_or("no body")?;
            let pull = *child.rotation() * to_parry(joint.axis()) * effort;
            let at = child.center_of_mass();
            match joint.kind {
                JointKind::Prismatic => child.add_force(pull, false),
                _ => child.add_torque(pull, false),
            }
            let Some(parent) = link.parent.and_then(|p| self.world.bodies.get_mut(self.template.links[p])) else {
                continue;
            };
            match joint.kind {
                JointKind::Prismatic => parent.add_force_at_point(-pull, at, false),
                _ => parent.add_torque(-pull, false),
            }
        }
        let dofs = robot.root_dofs();
        let Some((multibody, _)) = self.multibody() else { return Ok(()) };
        for (i, joint) in robot.joints().enumerate() {
            if joint.limit.is_none() && joint.stiffness == 0.0 {
                continue;
            }
            let link = multibody.link_mut(i + 1).ok_or("no link")?;
            let q = link.joint.coords()[axis(joint)];
            let end = joint.limit.map_or(q, |l| q.clamp(l.lower, l.upper));
            let limit = joint.limit.filter(|_| end != q);
            let (stiffness, damping) = limit.map_or((0.0, 0.0), |l| (l.stiffness, l.damping));
            // rapier has one spring per joint. Where limit and joint spring act together, their combined rest position
            // lies between both.
            let all = stiffness + joint.stiffness;
            let rest =
                if joint.stiffness == 0.0 { end } else { (stiffness * end + joint.stiffness * joint.rest) / all };
            link.joint.set_spring(axis(joint), all, rest);
            multibody.damping_mut()[dofs + i] = joint.damping + damping;
        }
        Ok(())
    }

    /// Reads back (q, qd), with local velocities.
    fn read(&mut self, robot: &Robot, q: &mut [f64], qd: &mut [f64]) -> Result<(), String> {
        let (dofs, coords) = (robot.root_dofs(), robot.root_coords());
        let com = self.template.root_com;
        let root = self.template.links[0];
        if let Some((multibody, _)) = self.multibody() {
            for (i, joint) in robot.joints().enumerate() {
                q[coords + i] = multibody.link(i + 1).ok_or("no link")?.joint.coords()[axis(joint)];
            }
            qd[dofs..].copy_from_slice(&multibody.generalized_velocity().as_slice()[dofs..]);
        }
        if !robot.floating() {
            return Ok(());
        }
        let body = self.world.bodies.get(root).ok_or("no root")?;
        let mut pose = pose_from_parry(body.position());
        let mut speed = from_parry(&body.linvel());
        let mut spin = from_parry(&body.angvel());
        if let Some((multibody, _)) = self.multibody() {
            pose = pose_from_parry(multibody.root().local_to_world());
            let velocity = multibody.generalized_velocity();
            (speed, spin) = (vector(&velocity.as_slice()[..3]), vector(&velocity.as_slice()[3..6]));
        }
        let arm = pose.rotation * com;
        q[..3].copy_from_slice((pose.translation.vector - arm).as_slice());
        // Of the two quaternions of a rotation, take the one nearer to the previous.
        let before = raw_quaternion(&q[3..]);
        write_quaternion(&mut q[3..7], &pose.rotation);
        if pose.rotation.quaternion().dot(&before) < 0.0 {
            q[3..7].iter_mut().for_each(|x| *x = -*x);
        }
        qd[..3].copy_from_slice(spin.as_slice());
        qd[3..6].copy_from_slice((speed - spin.cross(&arm)).as_slice());
        Ok(())
    }
}

/// Rotates a floating root about the world origin; velocities are local.
fn turned(turn: &UnitQuaternion<f64>, q: &mut [f64], qd: &mut [f64]) {
    let orientation = turn * quaternion(&q[3..7]);
    write_quaternion(&mut q[3..7], &orientation);
    for vector3 in [&mut q[..3], &mut qd[..3]] {
        let turned = turn * vector(vector3);
        vector3.copy_from_slice(turned.as_slice());
    }
    let turned = turn * vector(&qd[3..6]);
    qd[3..6].copy_from_slice(turned.as_slice());
}
