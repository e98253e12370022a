//! Jacobians of frames and of the centre of mass. Also the pose and velocity of one frame, computed from its ancestor
//! joints alone.

use nalgebra::{DMatrix, Rotation3};

use super::kinematics::{hung, root_rotation};
use super::velocities;
use crate::{prelude::*, velocity::root_position};

/// The axes in which a Jacobian expresses velocities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// World axes at the frame's origin (Pinocchio's `LOCAL_WORLD_ALIGNED`).
    World,
    /// The frame's axes (Pinocchio's `LOCAL`).
    Local,
}

impl Data {
    /// Jacobian J of a frame ([`Robot::frame`]), 6 by `nv`, with `qd` in the local form. `J qd` is the angular velocity
    /// of the frame (rad/s), then the velocity of the frame's origin (m/s). J is zero for a frame on a fixed base.
    ///
    /// Column of DoF k: the joint axis `(w, v)` as a motion at the frame's origin `x`, `(w, v + w x x)`. Columns are
    /// zero for joints that are not ancestors of the frame.
    pub fn jacobian(&mut self, robot: &Robot, q: &[f64], frame: &FixedFrame, axes: Axes) -> &DMatrix<f64> {
        self.place(robot, q);
        self.jacobian.fill(0.0);
        if let Some(link) = frame.link {
            let x = self.position[link] + self.rotation[link] * frame.pose.translation.vector;
            for i in robot.ancestors(link) {
                match robot.links[i].joint {
                    Some(_) => add(&mut self.jacobian, self.dof[i], &self.axis[i], &x),
                    None => (0..6).for_each(|k| add(&mut self.jacobian, k, &Motion::unit(k), &x)),
                }
            }
        }
        if axes == Axes::Local {
            let back = self.back(frame);
            for mut column in self.jacobian.column_iter_mut() {
                for at in [0, 3] {
                    let turned = back * column.fixed_rows::<3>(at);
                    column.fixed_rows_mut::<3>(at).copy_from(&turned);
                }
            }
        }
        &self.jacobian
    }

    /// Time derivative of `Data::jacobian` at velocity `qd`: the frame's acceleration is `J qdd + J_dot qd`.
    ///
    /// A joint axis moves with the link that carries it, `S_dot = V x S`, and the frame's origin moves at `x_dot`. The
    /// time derivative of a column `(w, v + w x x)` is `(w_dot, v_dot + w_dot x x + w x x_dot)`. The axes of a floating
    /// root are fixed in direction and move with the root's origin.
    pub fn jacobian_rate(
        &mut self,
        robot: &Robot,
        q: &[f64],
        qd: &LocalVelocity<impl AsRef<[f64]>>,
        frame: &FixedFrame,
        axes: Axes,
    ) -> &DMatrix<f64> {
        self.jacobian(robot, q, frame, axes);
        velocities(robot, qd.0.as_ref(), self);
        let Some(link) = frame.link else { return &self.jacobian };
        let x = self.position[link] + self.rotation[link] * frame.pose.translation.vector;
        let speed = self.velocity[link].at(&x);
        self.rate.fill(0.0);
        for i in robot.ancestors(link) {
            let carrier = robot.links[i].parent.map_or(Motion::default(), |p| self.velocity[p]);
            match robot.links[i].joint {
                Some(_) => {
                    let mut turned = carrier.cross(&self.axis[i]);
                    turned.lin += self.axis[i].ang.cross(&speed);
                    add(&mut self.rate, self.dof[i], &turned, &x);
                }
                None => (0..3).for_each(|k| {
                    let turned = Vector3::ith(k, 1.0).cross(&(speed - self.velocity[i].lin));
                    add(&mut self.rate, k, &Motion::new(Vector3::zeros(), turned), &x);
                }),
            }
        }
        if axes == Axes::Local {
            // The time derivative of R^T J is R^T J_dot - (R^T w) x R^T J.
            let back = self.back(frame);
            let spin = back * self.velocity[link].ang;
            for (mut column, own) in self.rate.column_iter_mut().zip(self.jacobian.column_iter()) {
                for at in [0, 3] {
                    let turned = back * column.fixed_rows::<3>(at) - spin.cross(&own.fixed_rows::<3>(at));
                    column.fixed_rows_mut::<3>(at).copy_from(&turned);
                }
            }
        }
        &self.rate
    }

    /// Centre of mass in the world (m), and its Jacobian J, 3 by `nv`. `J qd` is the velocity of the centre of mass
    /// (m/s, world axes). For a robot without mass, centre and Jacobian are NaN.
    ///
    /// Column of DoF k: `m_k / m` times the velocity of the subtree's centre of mass per unit rate of the DoF. `m_k` is
    /// the subtree's mass and m the robot's.
    pub fn com_jacobian(&mut self, robot: &Robot, q: &[f64]) -> (Vector3<f64>, DMatrix<f64>) {
        self.place(robot, q);
        let n = robot.links.len();
        let mut masses = vec![0.0; n];
        let mut moments = vec![Vector3::zeros(); n];
        let mut mass = 0.0;
        let mut moment = Vector3::zeros();
        for (i, link) in robot.links.iter().enumerate().rev() {
            masses[i] += link.inertia.mass;
            moments[i] += (self.position[i] + self.rotation[i] * link.inertia.com) * link.inertia.mass;
            let own = masses[i];
            let at = moments[i];
            match link.parent {
                Some(p) => (masses[p], moments[p]) = (masses[p] + own, moments[p] + at),
                None => (mass, moment) = (mass + own, moment + at),
            }
        }
        let mut out = DMatrix::zeros(3, robot.nv());
        for (i, link) in robot.links.iter().enumerate() {
            let mut add = |k: usize, m: &Motion| {
                let v = (m.lin * masses[i] + m.ang.cross(&moments[i])) / mass;
                (0..3).for_each(|r| out[(r, k)] += v[r]);
            };
            match link.joint {
                Some(_) => add(self.dof[i], &self.axis[i]),
                None => (0..6).for_each(|k| add(k, &Motion::unit(k))),
            }
        }
        (self.origin + moment / mass, out)
    }

    /// Rotation from world axes to a frame's axes. Needs `kinematics`.
    fn back(&self, frame: &FixedFrame) -> Matrix3<f64> {
        let link = frame.link.map_or(Matrix3::identity(), |link| self.rotation[link]);
        (link * frame.pose.rotation.to_rotation_matrix().matrix()).transpose()
    }
}

/// Adds `motion`, with its linear part moved to the point `x` (m), to column k.
fn add(out: &mut DMatrix<f64>, k: usize, motion: &Motion, x: &Vector3<f64>) {
    let v = motion.at(x);
    for r in 0..3 {
        out[(r, k)] += motion.ang[r];
        out[(3 + r, k)] += v[r];
    }
}

impl Robot {
    /// World pose of a frame ([`Robot::frame`]) at coordinates `q`.
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

    /// Angular velocity (rad/s) of a frame, and velocity (m/s) of the frame's origin, both in world axes.
    pub fn velocity(&self, q: &[f64], qd: &LocalVelocity<impl AsRef<[f64]>>, frame: &FixedFrame) -> Motion {
        let Some(link) = frame.link else { return Motion::default() };
        let (rotation, position, twist) = self.carried(q, Some(qd.0.as_ref()), link);
        Motion::new(twist.ang, twist.at(&(position + rotation * frame.pose.translation.vector)))
    }

    /// Rotation, position (m, from the root) and twist (about the root's position) of a link, in world axes. The twist
    /// is zero without `qd`.
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

    /// Index of a link's joint among the independent joints (mimic joints not counted).
    fn coordinate(&self, link: usize) -> usize {
        let first = usize::from(self.floating());
        if !self.mimics() {
            return link - first;
        }
        self.links[first..link].iter().filter(|l| l.joint.as_ref().is_some_and(|j| j.mimic().is_none())).count()
    }
}
