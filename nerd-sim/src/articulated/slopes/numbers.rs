//! The numbers of a robot and its scene that slopes are by, in one row.

use crate::prelude::*;

/// Where each is. Of every link its mass (kg), centre of mass (m), inertia about that (kg m^2, nine numbers) and where its joint is on the link
/// above (m); of every joint damping, dry friction and armature; of every contact point its place (m) and radius (m); of every collider the
/// material that the robot meets it with, and of a plane its normal and offset (m); gravity (m/s^2).
#[derive(Clone, Copy)]
pub(super) struct Layout {
    joints: usize,
    points: usize,
    colliders: usize,
    gravity: usize,
}

pub(super) const MASS: usize = 0;
pub(super) const COM: usize = 1;
pub(super) const INERTIA: usize = 4;
pub(super) const ORIGIN: usize = 13;
const LINK: usize = 16;
pub(super) const DAMPING: usize = 0;
pub(super) const FRICTION: usize = 1;
pub(super) const ARMATURE: usize = 2;
const JOINT: usize = 3;
pub(super) const RADIUS: usize = 3;
const POINT: usize = 4;
pub(super) const NORMAL: usize = 4;
pub(super) const OFFSET: usize = 7;
const COLLIDER: usize = 8;

impl Layout {
    pub(super) fn of(robot: &Robot, colliders: usize) -> Self {
        let joints = LINK * robot.links.len();
        let points = joints + JOINT * robot.joint_count();
        let first = points + POINT * robot.contact_points.len();
        Self { joints, points, colliders: first, gravity: first + COLLIDER * colliders }
    }

    pub(super) fn link(&self, i: usize, number: usize) -> usize {
        LINK * i + number
    }

    pub(super) fn joint(&self, i: usize, number: usize) -> usize {
        self.joints + JOINT * i + number
    }

    pub(super) fn point(&self, i: usize, number: usize) -> usize {
        self.points + POINT * i + number
    }

    pub(super) fn collider(&self, i: usize, number: usize) -> usize {
        self.colliders + COLLIDER * i + number
    }

    pub(super) fn gravity(&self) -> usize {
        self.gravity
    }

    fn len(&self) -> usize {
        self.gravity + 3
    }
}

/// The numbers of a robot and its scene that [`super::super::Articulated::back_by_numbers`] has slopes by, in its order.
pub fn numbers(system: &System, scene: &Scene) -> Vec<f64> {
    let robot = &system.robot;
    let at = Layout::of(robot, scene.colliders.len());
    let mut out = vec![0.0; at.len()];
    let mut set = |first: usize, numbers: &[f64]| out[first..first + numbers.len()].copy_from_slice(numbers);
    for (i, link) in robot.links.iter().enumerate() {
        set(at.link(i, MASS), &[link.inertia.mass]);
        set(at.link(i, COM), link.inertia.com.as_slice());
        set(at.link(i, INERTIA), link.inertia.inertia.as_slice());
        set(at.link(i, ORIGIN), link.joint.as_ref().map_or(Vector3::zeros(), |j| j.origin().translation.vector).as_slice());
    }
    for (i, joint) in robot.joints().enumerate() {
        set(at.joint(i, 0), &[joint.damping, joint.friction, joint.armature]);
    }
    for (i, point) in robot.contact_points.iter().enumerate() {
        set(at.point(i, 0), point.local.as_slice());
        set(at.point(i, RADIUS), &[point.radius]);
    }
    for (i, collider) in scene.colliders.iter().enumerate() {
        let m = collider.material.mean(&system.spec.material);
        set(at.collider(i, 0), &[m.stiffness, m.damping, m.friction_damping, m.friction]);
        if let Some(plane) = &collider.plane {
            set(at.collider(i, NORMAL), plane.normal.as_slice());
            set(at.collider(i, OFFSET), &[plane.offset]);
        }
    }
    set(at.gravity(), scene.gravity.as_slice());
    out
}

/// Gradients by numbers on their way back; nothing where they are not asked for.
pub(super) struct Numbers {
    at: Layout,
    pub(super) values: Vec<f64>,
}

impl Numbers {
    pub(super) fn new(robot: &Robot, scene: &Scene, asked: bool) -> Self {
        let at = Layout::of(robot, scene.colliders.len());
        Self { at, values: vec![0.0; if asked { at.len() } else { 0 }] }
    }

    pub(super) fn asked(&self) -> bool {
        !self.values.is_empty()
    }

    /// Adds to what begins at a place of the layout.
    pub(super) fn add<const N: usize>(&mut self, at: impl FnOnce(&Layout) -> usize, by: [f64; N]) {
        if self.asked() {
            let first = at(&self.at);
            self.values[first..].iter_mut().zip(by).for_each(|(v, b)| *v += b);
        }
    }

    /// Adds what the inertia of link i does to `scale x . I z`, that is `m x(c) . z(c) + x_ang . I_c z_ang` at the centre of mass c.
    pub(super) fn inertia(&mut self, robot: &Robot, data: &Data, i: usize, scale: f64, [x, z]: [&Motion; 2]) {
        let (body, r) = (&robot.links[i].inertia, &data.rotation[i]);
        let c = data.position[i] + r * body.com;
        let (xc, zc) = (x.at(&c), z.at(&c));
        let by_com = r.tr_mul(&(zc.cross(&x.ang) + xc.cross(&z.ang))) * (scale * body.mass);
        self.add(|at| at.link(i, MASS), [scale * xc.dot(&zc)]);
        self.add(|at| at.link(i, COM), by_com.into());
        let by: Matrix3<f64> = r.tr_mul(&x.ang) * r.tr_mul(&z.ang).transpose() * scale;
        self.add::<9>(|at| at.link(i, INERTIA), std::array::from_fn(|k| by.as_slice()[k]));
    }

    /// Adds gradients by a contact point's place on its link and by its radius, if it does not move over it.
    pub(super) fn point(&mut self, robot: &Robot, point: usize, by_local: Vector3<f64>, by_radius: f64) {
        if robot.contact_points[point].locus.is_fixed() {
            self.add(|at| at.point(point, 0), by_local.into());
            self.add(|at| at.point(point, RADIUS), [by_radius]);
        }
    }
}
