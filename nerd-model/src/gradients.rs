//! Vector-Jacobian products around the network: of a token with respect to the state, and of the next state with
//! respect to prediction and state.
//!
//! A gradient with respect to a state has the `2 nv` numbers of its tangent space: `[pose, velocities]`, each laid out
//! as `qd`, angular part first. A free root has a rotation vector, a translation (m), an angular and a linear velocity,
//! all in its **body axes**: `R -> R exp(t)`, `x -> x + R d`, `a = R^-1 w`, `b = R^-1 x_dot`. With the predicted change
//! `(d, n, c_a, c_b)` of the root a frame is
//!
//! ```text
//! A = a + c_a   B = b + c_b + A x d   x' = x + R d   R' = R n   a' = n^-1 A   b' = n^-1 B
//! ```
//!
//! and changes of joints are added. Gradients neglect the curvature of surfaces: normals rotate with the root, but do
//! not change with position. The deepest point of a hull or rim and the set of visible contacts are held constant.

use nalgebra::Quaternion;
use nerd_core::tangent::{push, wrenches_back};
use nerd_core::{dynamics::velocities, frames::own_velocity};

use crate::features::{Features, nearness_gradient, waves};
use crate::form::View;
use crate::prelude::*;
use crate::program::cpu::add;

/// What a token is computed from.
pub struct Seen<'a> {
    /// State `[q, qd]`.
    pub state: &'a [f64],
    /// Contact events of all contact points.
    pub contacts: &'a [ContactEvent],
    /// Gravity (m/s^2, world axes).
    pub gravity: Vector3<f64>,
    /// Content of the token.
    pub view: View,
    /// Frame time (s).
    pub frame_time: f64,
}

/// Adjoint of [`Features::token`]: adds to `gradient[2 nv]` the gradient with respect to the state, from
/// `by_token[inputs]`, the gradient with respect to the unnormalised token.
pub fn token_back(robot: &Robot, seen: &Seen, by_token: &[f64], data: &mut Data, gradient: &mut [f64]) {
    let mut rest = Rest(by_token);
    // In its own frame the root has a constant pose, without gradient.
    rest.take(robot.root_coords());
    let by_angles = rest.take(robot.joint_count());
    add(&mut gradient[robot.nv()..], rest.take(robot.nv()));
    angles_back(robot, seen, by_angles, by_token, gradient);
    if !Features::situated(robot) {
        return;
    }
    kinematics(robot, seen.state, data);
    if seen.moving() {
        let (q, qd) = robot.split(seen.state);
        velocities(robot, &qd.to_local(robot, q).0, data);
    }
    let mut loads = Loads::new(robot);
    loads.back_through_contacts(robot, seen, data, &mut rest, gradient);
    rest.take(robot.joint_count());
    let by_gravity = vector(rest.take(3));
    if seen.moving() {
        loads.back_through_axes(data, &mut rest);
    }
    loads.back_through_root(seen, data, &by_gravity);
    wrenches_back(robot, data, &mut loads.forces, gradient);
    wrenches_back(robot, data, &mut loads.impulses, &mut gradient[robot.nv()..]);
}

/// The part of a token that is still to be read.
struct Rest<'a>(&'a [f64]);

impl<'a> Rest<'a> {
    fn take(&mut self, n: usize) -> &'a [f64] {
        let (now, later) = self.0.split_at(n);
        self.0 = later;
        now
    }
}

impl Seen<'_> {
    fn moving(&self) -> bool {
        self.view == View::Moving
    }
}

/// Adds the gradient through the joints' coordinates, and through their sines and cosines at the token's end.
fn angles_back(robot: &Robot, seen: &Seen, by_angles: &[f64], by_token: &[f64], gradient: &mut [f64]) {
    let ends: Vec<usize> = robot.joints().map(|joint| if seen.moving() { waves(joint) } else { 0 }).collect();
    let mut end = Rest(&by_token[by_token.len() - ends.iter().sum::<usize>()..]);
    for (i, (count, by)) in ends.into_iter().zip(by_angles).enumerate() {
        let (sin, cos) = seen.state[robot.root_coords() + i].sin_cos();
        gradient[robot.root_dofs() + i] += match *end.take(count) {
            [by_cos] => by * cos - by_cos * sin,
            [by_sin, by_cos] => by + by_sin * cos - by_cos * sin,
            _ => *by,
        };
    }
}

/// Gradients with respect to displacements (`forces`) and velocities (`impulses`) of links.
struct Loads {
    forces: Vec<Wrench>,
    impulses: Vec<Wrench>,
    /// Gradients with respect to rotation and translation of the root frame (body axes).
    turn: Vector3<f64>,
    shift: Vector3<f64>,
}

impl Loads {
    fn new(robot: &Robot) -> Self {
        let [forces, impulses] = [(); 2].map(|()| vec![Wrench::default(); robot.links.len()]);
        Self { forces, impulses, turn: Vector3::zeros(), shift: Vector3::zeros() }
    }

    /// Adds the gradient through the contact events. That of velocities with respect to the joints goes to `gradient`.
    fn back_through_contacts(
        &mut self,
        robot: &Robot,
        seen: &Seen,
        data: &Data,
        rest: &mut Rest,
        gradient: &mut [f64],
    ) {
        let r = data.rotation[0];
        let o = data.origin + data.position[0];
        let count = seen.contacts.len();
        let [normals, places, depths] = [rest.take(3 * count), rest.take(3 * count), rest.take(count)];
        let [speeds, nears] = if seen.moving() { [rest.take(3 * count), rest.take(2 * count)] } else { [&[][..]; 2] };
        let three = |all: &[f64], k: usize| vector(&all[3 * k..]);
        for (k, (event, point)) in seen.contacts.iter().zip(&robot.contact_points).enumerate() {
            if event.distance >= point.threshold() {
                continue;
            }
            let (by_normal, by_place) = (three(normals, k), three(places, k));
            self.turn += by_normal.cross(&r.tr_mul(&event.normal)) + by_place.cross(&r.tr_mul(&(event.p1 - o)));
            self.shift -= by_place;
            // The nearest surface point follows the contact point along the surface.
            let by_p1 = r * by_place;
            let mut by_depth = depths[k];
            if seen.moving() {
                let [now, later] = [nears[k], nears[count + k]];
                by_depth += self.back_through_speed(
                    (robot, seen, data),
                    (event, point),
                    (three(speeds, k), now, later),
                    gradient,
                );
            }
            let force = by_p1 + event.normal * (by_depth - event.normal.dot(&by_p1));
            push(data, point, event, force, &mut self.forces);
        }
    }

    /// Adds the gradient through a contact point's velocity, and through its nearness `now` and one frame `later`.
    /// Returns the gradient with respect to its distance.
    fn back_through_speed(
        &mut self,
        (robot, seen, data): (&Robot, &Seen, &Data),
        (event, point): (&ContactEvent, &ContactPoint),
        (by_speed, by_now, by_later): (Vector3<f64>, f64, f64),
        gradient: &mut [f64],
    ) -> f64 {
        let r = data.rotation[0];
        let at = event.p0 - data.origin;
        let velocity = data.velocity[point.link].at(&at);
        let gap = |ahead: f64| event.distance - point.radius + ahead * event.normal.dot(&velocity);
        let now = by_now * nearness_gradient(gap(0.0));
        let later = by_later * nearness_gradient(gap(seen.frame_time));
        let by_closing = later * seen.frame_time;
        let along = r * by_speed + event.normal * by_closing;
        self.impulses[point.link] += Wrench::force_at(along, &at);
        quickened(robot, data, point.link, &at, &along, gradient);
        // A floating root's velocity is expressed in axes that rotate with it.
        self.turn += if robot.floating() {
            r.tr_mul(&velocity.cross(&event.normal)) * by_closing
        } else {
            by_speed.cross(&r.tr_mul(&velocity))
        };
        now + later
    }

    /// Adds the gradient through the axes of links.
    fn back_through_axes(&mut self, data: &Data, rest: &mut Rest) {
        let r = data.rotation[0];
        for link in 1..self.forces.len() {
            for (column, by) in data.rotation[link].column_iter().zip([rest.take(3), rest.take(3)]) {
                let axis = column.into_owned();
                let by = vector(by);
                self.turn += by.cross(&r.tr_mul(&axis));
                self.forces[link].ang += axis.cross(&(r * by));
            }
        }
    }

    /// Adds the gradient through the direction of gravity, and moves the gradients of the root frame to its link.
    fn back_through_root(&mut self, seen: &Seen, data: &Data, by_gravity: &Vector3<f64>) {
        let r = data.rotation[0];
        let down = seen.gravity / seen.gravity.norm().max(f64::MIN_POSITIVE);
        self.turn += by_gravity.cross(&r.tr_mul(&down));
        let o = data.origin + data.position[0];
        self.forces[0] += Wrench::force_at(r * self.shift, &(o - data.origin));
        self.forces[0].ang += r * self.turn;
    }
}

/// Adds the gradient of `along . v`, v the velocity of a link's point at `x`, with respect to the link's joints. For a
/// joint axis `(a, b)`, `w` the parent's angular velocity and `u` the point's velocity relative to the parent:
/// `dv = w x (a x x + b) + a x u`.
fn quickened(robot: &Robot, data: &Data, link: usize, x: &Vector3<f64>, along: &Vector3<f64>, gradient: &mut [f64]) {
    let velocity = data.velocity[link].at(x);
    for i in robot.ancestors(link).filter(|i| robot.links[*i].joint.is_some()) {
        let parent = robot.links[i].parent.map_or(Motion::default(), |p| data.velocity[p]);
        let way = parent.ang.cross(&data.axis[i].at(x)) + data.axis[i].ang.cross(&(velocity - parent.at(x)));
        gradient[data.dof[i]] += along.dot(&way);
    }
}

/// Adjoint of [`Features::apply`] for the gradient `upstream[2 nv]` with respect to the next state. Adds the gradient
/// with respect to the state to `gradient[2 nv]`, and writes the gradient with respect to `change` to `by_change`.
pub fn apply_back(
    robot: &Robot,
    state: &[f64],
    change: &[f64],
    upstream: &[f64],
    gradient: &mut [f64],
    by_change: &mut [f64],
) {
    let nq = robot.nq();
    let nv = robot.nv();
    let dofs = robot.root_dofs();
    let coords = robot.root_coords();
    for i in 0..nv - dofs {
        by_change[coords + i] = upstream[dofs + i];
        by_change[nq + dofs + i] = upstream[nv + dofs + i];
        gradient[dofs + i] += upstream[dofs + i];
        gradient[nv + dofs + i] += upstream[nv + dofs + i];
    }
    if !robot.floating() {
        return;
    }
    let [a, b] = own_velocity(state, nq);
    let d = vector(change);
    let raw = raw_quaternion(&change[3..]);
    let n = UnitQuaternion::from_quaternion(raw);
    let part = |all: &[f64], at: usize| vector(&all[at..]);
    let spin = a + part(change, nq);
    let speed = b + part(change, nq + 3) + spin.cross(&d);
    let [by_turn, by_shift, by_a, by_b] = [0, 3, nv, nv + 3].map(|at| part(upstream, at));
    let (by_spin, by_speed, by_x) = (n * by_a, n * by_b, n * by_shift);
    let by_own = by_spin + d.cross(&by_speed);
    let by_n =
        by_turn + by_a.cross(&n.inverse_transform_vector(&spin)) + by_b.cross(&n.inverse_transform_vector(&speed));
    let by_quaternion = n.into_inner() * Quaternion::from_imag(by_n * (2.0 / raw.norm()));
    by_change[..3].copy_from_slice((by_x + by_speed.cross(&spin)).as_slice());
    by_change[3..7].copy_from_slice(by_quaternion.coords.as_slice());
    by_change[nq..nq + 3].copy_from_slice(by_own.as_slice());
    by_change[nq + 3..nq + 6].copy_from_slice(by_speed.as_slice());
    let parts = [(0, n * by_turn + d.cross(&by_x)), (3, by_x), (nv, by_own), (nv + 3, by_speed)];
    parts.iter().for_each(|(at, g)| add(&mut gradient[*at..at + 3], g.as_slice()));
}
