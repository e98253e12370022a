//! Scales a robot to another size.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::{Base, JointKind, Robot, Shape, ShapeKind};
use crate::spatial::BodyInertia;

impl Robot {
    /// Multiplies all lengths by `factor` at the same masses: shapes, contact points, joint frames, centres of mass.
    /// Rotational inertias grow by the square of `factor`.
    pub fn scale(&mut self, factor: f64) {
        let own = self.contact_points == self.default_contact_points();
        if let Base::Fixed(pose) = &mut self.base {
            *pose = scaled(pose, factor);
        }
        let metres: Vec<bool> = self.joints().map(|j| j.kind == JointKind::Prismatic).collect();
        for link in &mut self.links {
            link.inertia.com *= factor;
            link.lifted.at *= factor;
            link.inertia.inertia *= factor * factor;
            link.shapes.iter_mut().for_each(|shape| shape.scale(factor));
            link.frame = scaled(&link.frame, factor);
            if let Some(joint) = &mut link.joint {
                joint.set_origin(scaled(joint.origin(), factor));
                let own = joint.kind == JointKind::Prismatic;
                if let Some(mimic) = &mut joint.mimic {
                    mimic.offset *= if own { factor } else { 1.0 };
                    mimic.multiplier *= match (own, metres[mimic.coordinate]) {
                        (true, false) => factor,
                        (false, true) => 1.0 / factor,
                        _ => 1.0,
                    };
                }
            }
        }
        self.frames.iter_mut().for_each(|frame| frame.pose = scaled(&frame.pose, factor));
        if own {
            self.contact_points = self.default_contact_points();
        } else {
            self.contact_points.iter_mut().for_each(|p| *p = p.scaled(factor));
        }
    }
}

impl Shape {
    fn scale(&mut self, factor: f64) {
        self.pose = scaled(&self.pose, factor);
        match &mut self.kind {
            ShapeKind::Sphere { radius } => *radius *= factor,
            ShapeKind::Box { half } => *half *= factor,
            ShapeKind::Cylinder { radius, half_length } | ShapeKind::Capsule { radius, half_length } => {
                *radius *= factor;
                *half_length *= factor;
            }
        }
    }
}

impl BodyInertia {
    /// Spreads mass along the link's axis `axis` (0, 1, 2: x, y, z). Multiplies the second moment of mass along this
    /// axis by `factor` and keeps the other two. So the inertia stays physically possible.
    pub fn spread(&mut self, axis: usize, factor: f64) {
        let mut moments = nalgebra::Matrix3::identity() * (0.5 * self.inertia.trace()) - self.inertia;
        moments.row_mut(axis).scale_mut(factor.sqrt());
        moments.column_mut(axis).scale_mut(factor.sqrt());
        self.inertia = nalgebra::Matrix3::identity() * moments.trace() - moments;
    }
}

fn scaled(pose: &Isometry3<f64>, factor: f64) -> Isometry3<f64> {
    let t: Vector3<f64> = pose.translation.vector * factor;
    Isometry3::from_parts(Translation3::from(t), pose.rotation)
}
