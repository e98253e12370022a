//! Tokens and targets of the network (paper A.1): all in the robot's root frame, computed in f64, then cast to f32.
//!
//! A token of a robot with C contact points, or with a free base:
//! `[state, normals (3 C), scene points (3 C), depths (C), torques, gravity direction (3)]`, all in the frame B of the
//! root. Quantities of a contact are masked to zero at distances of `xi` (m) or more, the threshold of the contact
//! point. A token of any other robot: `[state, torques]`.
//!
//! [`View::Moving`] adds velocities of contact points (3 C, m/s), masked likewise, after the depths. Nearness of each
//! contact point now and one frame later (2 C) follows; it is 1 beyond `xi`. After gravity come the x and y axes of
//! every link but the first (6 each). Sine and cosine of every joint angle end the token. The sine of an angle that
//! wraps replaces the angle.
//!
//! A token conditioned on the robot's parameters ([`Form::told`]) has the drawn parameters after all other numbers
//! ([`Told`]).
//!
//! The target is the change of the state over one time step, in the token's frame B. For positions, joints and
//! velocities it is a difference (angles wrapped). For the rotation of a floating root it is a quaternion, multiplied
//! from the left. [`Base`] is the state to which the change is added.
//!
//! Apart from torques and drawn parameters, no token or target contains a mass, force or acceleration.

use nerd_core::dynamics::{link_pose, velocities};
use nerd_core::state::wrap_state;
use nerd_sim::vary::Told;

use crate::base::Base;
use crate::form::{Form, View};
use crate::prelude::*;
use crate::trapezoid;

/// Length scale (m) of [`nearness`], which resolves gaps up to this size.
pub(crate) const NEAR: f64 = 0.004;

/// Converts states to tokens and predictions to states, for one system.
#[derive(Clone)]
pub struct Features {
    system: Arc<System>,
    form: Form,
    data: Data,
    velocities: Vec<Vector3<f64>>,
    near: Vec<f64>,
    far: Vec<f64>,
    /// The parameters that tokens are conditioned on, and their values in [-1, 1].
    told: (Told, Vec<f64>),
}

impl Features {
    /// Features of `system` in a form.
    pub fn new(system: &Arc<System>, form: impl Into<Form>) -> Self {
        let d = system.robot.state_dim();
        let data = Data::new(&system.robot);
        let near = vec![0.0; d];
        let far = vec![0.0; d];
        let form = form.into();
        let told = if form.told { Told::new(system) } else { Told::default() };
        let mut new =
            Self { data, system: system.clone(), form, velocities: Vec::new(), near, far, told: (told, Vec::new()) };
        new.tell(&[]);
        new
    }

    /// Sets the drawn parameters of the robot in the next tokens; an empty slice means the nominal robot.
    pub fn tell(&mut self, drawn: &[f64]) {
        let (told, numbers) = &mut self.told;
        numbers.clear();
        numbers.extend(told.numbers(drawn));
    }

    /// Whether tokens contain contacts and gravity: the robot has contact points or a free base.
    pub(crate) fn situated(robot: &Robot) -> bool {
        robot.floating() || !robot.contact_points.is_empty()
    }

    /// Width of a token.
    pub fn inputs(system: &System, form: impl Into<Form>) -> usize {
        let form = form.into();
        let moving = form.view == View::Moving;
        let plain = Self::torques(system, form) + system.robot.joint_count();
        let plain = plain + if form.told { Told::new(system).count() } else { 0 };
        let plain = plain + if moving { system.robot.joints().map(waves).sum() } else { 0 };
        let axes = if moving { 6 * (system.robot.links.len() - 1) } else { 0 };
        if Self::situated(&system.robot) { plain + 3 + axes } else { plain }
    }

    /// Offset of the torques in a token.
    pub(crate) fn torques(system: &System, form: Form) -> usize {
        system.robot.state_dim() + Self::a_point(form.view) * system.robot.contact_points.len()
    }

    /// Number of entries in a token per contact point.
    fn a_point(view: View) -> usize {
        if view == View::Moving { 12 } else { 7 }
    }

    /// Width of a prediction.
    pub fn outputs(system: &System) -> usize {
        system.robot.state_dim()
    }

    /// The frame B of a state: pose of the floating base, or of the first moving link.
    fn frame(&mut self, state: &[f64]) -> RootFrame {
        let robot = &self.system.robot;
        if robot.floating() {
            return RootFrame::of(state);
        }
        kinematics(robot, state, &mut self.data);
        RootFrame::at(&link_pose(&self.data, 0))
    }

    /// Writes the token of a frame, `[inputs]`, not normalised: the state before the frame, its contacts, the torques
    /// over it, gravity (m/s^2).
    pub fn token(
        &mut self,
        state: &[f64],
        contacts: &[ContactEvent],
        torques: &[f64],
        gravity: &Vector3<f64>,
        out: &mut [f32],
    ) {
        let system = self.system.clone();
        let situated = Self::situated(&system.robot);
        let frame = if situated { self.frame(state) } else { world() };
        if situated && self.form.view == View::Moving {
            self.move_points(state, contacts);
        }
        if situated {
            frame.state_in(&system.robot, state, &mut self.near);
            wrap_state(&system.robot, &mut self.near);
        } else {
            self.near.copy_from_slice(state);
        }
        let waves = self.waves();
        let (mut rest, told) = out.split_at_mut(out.len() - self.told.1.len());
        cast(&self.told.1, told);
        let mut put = |x: &[f64]| {
            let (now, later) = std::mem::take(&mut rest).split_at_mut(x.len());
            cast(x, now);
            rest = later;
        };
        put(&self.near);
        if !situated {
            put(torques);
            return put(&waves);
        }
        // The mask zeroes inputs of the network. A masked event does not mean a contact at the frame's origin.
        let seen = |k: usize| contacts[k].distance < system.robot.contact_points[k].threshold();
        let none = Vector3::zeros();
        let normals = contacts.iter().map(|event| frame.direction(&event.normal)).enumerate();
        for (k, vector) in normals.chain(contacts.iter().map(|event| frame.point(&event.p1)).enumerate()) {
            put(if seen(k) { vector } else { none }.as_slice());
        }
        contacts.iter().enumerate().for_each(|(k, event)| put(&[if seen(k) { event.distance } else { 0.0 }]));
        for (k, velocity) in self.velocities.iter().enumerate() {
            put(if seen(k) { frame.direction(velocity) } else { none }.as_slice());
        }
        if self.form.view == View::Moving {
            for ahead in [0.0, system.frame_time] {
                for (k, (event, velocity)) in contacts.iter().zip(&self.velocities).enumerate() {
                    let gap =
                        event.distance - system.robot.contact_points[k].radius + ahead * event.normal.dot(velocity);
                    put(&[if seen(k) { nearness(gap) } else { 1.0 }]);
                }
            }
        }
        put(torques);
        let norm = gravity.norm();
        put((frame.direction(gravity) / if norm > 0.0 { norm } else { 1.0 }).as_slice());
        if self.form.view == View::Moving {
            let own = self.data.rotation[0];
            for rotation in &self.data.rotation[1..] {
                put(&own.tr_mul(rotation).as_slice()[..6]);
            }
        }
        put(&waves);
    }

    /// The sines and cosines that end a token. The sine of a wrapping angle replaces the angle in `near`.
    fn waves(&mut self) -> Vec<f64> {
        let robot = &self.system.robot;
        let mut end = Vec::new();
        for (joint, q) in
            robot.joints().zip(&mut self.near[robot.root_coords()..]).filter(|_| self.form.view == View::Moving)
        {
            let (sin, cos) = q.sin_cos();
            match waves(joint) {
                0 => continue,
                1 => *q = sin,
                _ => end.push(sin),
            }
            end.push(cos);
        }
        end
    }

    /// Writes the velocity of each contact point (m/s, world axes) to `velocities`.
    fn move_points(&mut self, state: &[f64], contacts: &[ContactEvent]) {
        let robot = &self.system.robot;
        let data = &mut self.data;
        let (q, qd) = robot.split(state);
        // For a fixed base, `frame` has already computed the kinematics.
        if robot.floating() {
            kinematics(robot, q, data);
        }
        velocities(robot, &qd.to_local(robot, q).0, data);
        let speed =
            |(event, point): (&ContactEvent, &ContactPoint)| data.velocity[point.link].at(&(event.p0 - data.origin));
        self.velocities.clear();
        self.velocities.extend(contacts.iter().zip(&robot.contact_points).map(speed));
    }

    /// The frame in which changes are expressed: a floating root's, otherwise the world.
    fn place(&self, state: &[f64]) -> RootFrame {
        if self.system.robot.floating() { RootFrame::of(state) } else { world() }
    }

    /// Writes the target of a frame from `state` to `next`, `[outputs]`, not normalised.
    pub fn target(&mut self, state: &[f64], next: &[f64], out: &mut [f32]) {
        let system = self.system.clone();
        let robot = &system.robot;
        let frame = self.place(state);
        frame.state_in(robot, state, &mut self.near);
        frame.state_in(robot, next, &mut self.far);
        let mut change: Vec<f64> = self.near.iter().zip(&self.far).map(|(a, b)| b - a).collect();
        for (i, _) in robot.joints().enumerate().filter(|(_, joint)| joint.wraps()) {
            let k = robot.root_coords() + i;
            change[k] = wrap(next[k] - state[k]);
        }
        if robot.floating() {
            let turn = quaternion(&self.far[3..7]) * quaternion(&self.near[3..7]).inverse();
            change[3..7].copy_from_slice(turn.coords.as_slice());
        }
        if self.form.base == Base::Trapezoid {
            trapezoid::carry(robot, system.frame_time, state, &mut change, -1.0);
        }
        cast(&change, out);
    }

    /// Applies `change` (as in [`Self::target`], not normalised) to `state`, and writes the resulting state to `next`.
    pub fn apply(&mut self, state: &[f64], change: &[f64], next: &mut [f64]) {
        let system = self.system.clone();
        let robot = &system.robot;
        let frame = self.place(state);
        frame.state_in(robot, state, &mut self.near);
        let mut change = change.to_vec();
        if self.form.base == Base::Trapezoid {
            trapezoid::carry(robot, system.frame_time, state, &mut change, 1.0);
        }
        self.far.iter_mut().zip(self.near.iter().zip(&change)).for_each(|(f, (n, c))| *f = n + c);
        if robot.floating() {
            let turned = quaternion(&change[3..7]) * quaternion(&self.near[3..7]);
            write_quaternion(&mut self.far[3..7], &turned);
        }
        frame.state_out(robot, &self.far, next);
    }
}

/// Number of entries that a joint's sine and cosine add to a token of [`View::Moving`]. A wrapping angle adds one,
/// another hinge two.
pub(crate) fn waves(joint: &Joint) -> usize {
    if joint.wraps() { 1 } else { 2 * usize::from(joint.kind != JointKind::Prismatic) }
}

/// Nearness of a gap (m): -1 in deep penetration, 0 at contact, 1 far away; steepest at contact.
pub(crate) fn nearness(gap: f64) -> f64 {
    gap / gap.hypot(NEAR)
}

pub(crate) fn nearness_gradient(gap: f64) -> f64 {
    NEAR * NEAR / gap.hypot(NEAR).powi(3)
}

/// The world frame.
fn world() -> RootFrame {
    RootFrame::at(&Isometry3::identity())
}

fn cast(x: &[f64], out: &mut [f32]) {
    out.iter_mut().zip(x).for_each(|(o, x)| *o = *x as f32);
}
