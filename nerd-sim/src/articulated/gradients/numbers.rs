//! All numbers of a robot and its scene that have gradients, in one vector.

use super::super::turning::{MIN_GYRATION, gyration};
use crate::prelude::*;

/// Index of a kind of part (links, joints, contact points, colliders, gravity), and a number's offset within one part.
pub(super) type Number = (usize, usize);

pub(super) const MASS: Number = (0, 0);
pub(super) const COM: Number = (0, 1);
pub(super) const INERTIA: Number = (0, 4);
pub(super) const ORIGIN: Number = (0, 13);
pub(super) const DAMPING: Number = (1, 0);
pub(super) const FRICTION: Number = (1, 1);
pub(super) const ARMATURE: Number = (1, 2);
const PLACE: Number = (2, 0);
const RADIUS: Number = (2, 3);
pub(super) const MATERIAL: Number = (3, 0);
pub(super) const NORMAL: Number = (3, 7);
pub(super) const OFFSET: Number = (3, 10);
pub(super) const GRAVITY: Number = (4, 0);
const WIDTHS: [usize; 5] = [16, 3, 4, 11, 3];

/// First index of each kind of part in the vector, and the vector's length. A link has mass (kg), centre of mass (m),
/// inertia about its centre of mass (nine numbers, kg m^2), and joint position on the link above (m). A joint has
/// damping (N m s/rad or N s/m), dry friction (N m or N) and armature (kg m^2 or kg). A contact point has place (m) and
/// radius (m). A collider has the material of the robot's contact with it, and, if a plane, normal and offset (m).
/// Geoms with contact laws of their own have multiples of this material. Last comes gravity (m/s^2).
#[derive(Clone, Copy)]
struct Layout([usize; 6]);

impl Layout {
    fn of(robot: &Robot, colliders: usize) -> Self {
        let mut starts = [0; 6];
        let counts = [robot.links.len(), robot.joint_count(), robot.contact_points.len(), colliders, 1];
        (0..5).for_each(|part| starts[part + 1] = starts[part] + WIDTHS[part] * counts[part]);
        Self(starts)
    }

    fn at(&self, (part, number): Number, i: usize) -> usize {
        self.0[part] + WIDTHS[part] * i + number
    }
}

/// Numbers of a robot and its scene, in the order of the gradients of [`super::super::Articulated::back_by_numbers`].
pub fn numbers(system: &System, scene: &Scene) -> Vec<f64> {
    let robot = &system.robot;
    let at = Layout::of(robot, scene.colliders.len());
    let mut out = vec![0.0; at.0[5]];
    let mut set = |number, i, numbers: &[f64]| out[at.at(number, i)..][..numbers.len()].copy_from_slice(numbers);
    for (i, link) in robot.links.iter().enumerate() {
        set(MASS, i, &[link.inertia.mass]);
        set(COM, i, link.inertia.com.as_slice());
        set(INERTIA, i, link.inertia.inertia.as_slice());
        set(ORIGIN, i, link.joint.as_ref().map_or(Vector3::zeros(), |j| j.origin().translation.vector).as_slice());
    }
    for (i, joint) in robot.joints().enumerate() {
        set(DAMPING, i, &[joint.damping, joint.friction, joint.armature]);
    }
    for (i, point) in robot.contact_points.iter().enumerate() {
        set(PLACE, i, point.local.as_slice());
        set(RADIUS, i, &[point.radius]);
    }
    for (i, collider) in scene.colliders.iter().enumerate() {
        let m = collider.material.mean(&system.spec.material);
        set(MATERIAL, i, &[m.stiffness, m.damping, m.friction_damping, m.friction, m.torsion, m.rolling, m.margin]);
        if let Some(plane) = &collider.plane {
            set(NORMAL, i, plane.normal.as_slice());
            set(OFFSET, i, &[plane.offset]);
        }
    }
    set(GRAVITY, 0, scene.gravity.as_slice());
    out
}

/// Accumulated gradients with respect to these numbers; empty unless requested.
pub(super) struct Numbers {
    at: Layout,
    pub(super) values: Vec<f64>,
}

impl Numbers {
    pub(super) fn new(robot: &Robot, scene: &Scene, asked: bool) -> Self {
        let at = Layout::of(robot, scene.colliders.len());
        Self { at, values: vec![0.0; if asked { at.0[5] } else { 0 }] }
    }

    pub(super) fn asked(&self) -> bool {
        !self.values.is_empty()
    }

    /// Adds `by` to the N gradients that begin at `number` of the i-th part.
    pub(super) fn add<const N: usize>(&mut self, number: Number, i: usize, by: [f64; N]) {
        if self.asked() {
            let first = self.at.at(number, i);
            self.values[first..].iter_mut().zip(by).for_each(|(v, b)| *v += b);
        }
    }

    /// Adds the gradients with respect to link i's inertia of `scale x . I z`, which is
    /// `m x(c) . z(c) + x_ang . I_c z_ang` at the centre of mass c.
    pub(super) fn inertia(&mut self, robot: &Robot, data: &Data, i: usize, scale: f64, [x, z]: [&Motion; 2]) {
        let body = &robot.links[i].inertia;
        let r = &data.rotation[i];
        let c = data.position[i] + r * body.com;
        let (xc, zc) = (x.at(&c), z.at(&c));
        let by_com = r.tr_mul(&(zc.cross(&x.ang) + xc.cross(&z.ang))) * (scale * body.mass);
        self.add(MASS, i, [scale * xc.dot(&zc)]);
        self.add(COM, i, by_com.into());
        let by: Matrix3<f64> = r.tr_mul(&x.ang) * r.tr_mul(&z.ang).transpose() * scale;
        self.add::<9>(INERTIA, i, std::array::from_fn(|k| by.as_slice()[k]));
    }

    /// Chain rule from a link's squared radius of gyration to its mass and inertia.
    pub(super) fn gyration(&mut self, link: &Link, i: usize, by: f64) {
        let Some(inverse) = link.inertia.inertia.try_inverse() else { return };
        let square = gyration(link);
        let m = link.inertia.mass;
        if square == MIN_GYRATION {
            return;
        }
        self.add(MASS, i, [-by * square / m]);
        let by: Matrix3<f64> = inverse * inverse * (by * square / inverse.trace());
        self.add::<9>(INERTIA, i, std::array::from_fn(|k| by.as_slice()[k]));
    }

    /// Adds gradients with respect to a contact point's place on its link and its radius, unless its locus moves.
    pub(super) fn point(&mut self, robot: &Robot, point: usize, by_local: Vector3<f64>, by_radius: f64) {
        if robot.contact_points[point].locus.is_fixed() {
            self.add(PLACE, point, by_local.into());
            self.add(RADIUS, point, [by_radius]);
        }
    }
}
