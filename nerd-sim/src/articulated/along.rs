//! Implicit step's equations solved along the tree in O(n), for robots with long chains: cables, hands, humanoids.
//!
//! A touch (contact, limit, drive or dry friction) resists the motion of one link or one joint. So
//! `(M + h sum J^T D J) qdd = right` is solved as forward dynamics by the articulated-body algorithm ([`TreeFactor`]).
//! A contact adds `h J_x^T D J_x` to the inertia of its link. A joint's resistance d adds `h d` to its armature.

use nalgebra::Matrix6;
use nerd_core::dynamics::TreeFactor;

use super::touch::Contact;
use crate::prelude::*;

/// Least cost of factorising the mass matrix, in multiplications per DoF, at which steps are solved along the tree. By
/// measurement, the tree is faster than the matrix for humanoids and for chains of twenty hinges. It is hardly faster,
/// or slower, for quadrupeds with three joints per leg.
const MIN_FACTOR_COST: usize = 60;
/// Least number of joints with springs at which a robot counts as a chain that may whip, however short.
const MIN_WHIP_JOINTS: usize = 3;

/// Whether a robot's implicit steps are solved along its tree and checked for whips. Otherwise its mass matrix is
/// factorised.
pub fn along(robot: &Robot) -> bool {
    let above: Vec<usize> =
        nerd_core::dynamics::Factor::new(robot).above().map(|p| p.map_or(usize::MAX, |p| p)).collect();
    let mut depths: Vec<usize> = Vec::new();
    above.iter().for_each(|p| depths.push(depths.get(*p).map_or(1, |d| d + 1)));
    chained(robot) || depths.iter().map(|d| d * d).sum::<usize>() >= MIN_FACTOR_COST * robot.nv()
}

/// Whether a robot has at least `MIN_WHIP_JOINTS` joints with springs.
pub(super) fn chained(robot: &Robot) -> bool {
    robot.joints().filter(|j| j.stiffness > 0.0).count() >= MIN_WHIP_JOINTS
}

pub(super) struct Tree {
    factor: TreeFactor,
    /// Implicit resistance: of each link, added to its inertia; of each joint, added to its armature (kg m^2 or kg).
    links: Vec<Matrix6<f64>>,
    joints: Vec<f64>,
    /// Contact wrench on each link (N m, N).
    press: Vec<Wrench>,
}

impl Tree {
    /// `None` where factorising the mass matrix is faster, or where that matrix takes other links' inertias
    /// (`stand_ins`).
    pub(super) fn new(system: &System) -> Option<Self> {
        let robot = &system.robot;
        let links = robot.links.len();
        let joints = robot.joint_count();
        (along(robot) && system.stand_ins.is_empty()).then(|| TreeFactor::new(robot)).flatten().map(|factor| Self {
            factor,
            links: vec![Matrix6::zeros(); links],
            joints: vec![0.0; joints],
            press: vec![Wrench::default(); links],
        })
    }

    /// Factorises the mass matrix without touches, for [`Tree::inv_mass`] and [`Tree::response`]; `false` if it is
    /// singular.
    pub(super) fn plain(&mut self, robot: &Robot, data: &Data) -> bool {
        let sound = self.factor.refill(robot, data, &[], &[]);
        if sound {
            self.factor.spread(robot, data);
        }
        sound
    }

    /// Inverse effective mass w of a joint (1/(kg m^2) or 1/kg); needs `plain`.
    pub(super) fn inv_mass(&self, robot: &Robot, joint: usize) -> f64 {
        self.factor.inv_mass(robot, joint + usize::from(robot.floating()))
    }

    /// Acceleration (m/s^2) of a contact's point under a force (N) there; needs `plain`.
    pub(super) fn response(&self, contact: &Contact, force: &Vector3<f64>) -> Vector3<f64> {
        let Contact { x, link, .. } = contact;
        self.factor.response(*link, &Wrench::force_at(*force, x)).at(x)
    }

    /// Begins a solve: sets the joints' resistance to their own, `shares` (kg m^2 or kg), and all others to zero.
    pub(super) fn clear(&mut self, shares: &[f64]) {
        self.links.fill(Matrix6::zeros());
        self.joints.copy_from_slice(shares);
        self.press.fill(Wrench::default());
    }

    /// Adds a contact's force and its resistance `h D`, `D = (along - across) n n^T + across`.
    pub(super) fn point(&mut self, contact: &Contact, h: f64) {
        let (force, along, across) = contact.push(h);
        let link = contact.link;
        let n = &contact.normal;
        let b = contact.x.cross_matrix();
        let d = (n * n.transpose() * (along - across) + Matrix3::identity() * across) * h;
        // J_x = [-x^, 1].
        let bd = b * d;
        let own = &mut self.links[link];
        let mut add = |row: usize, column: usize, block: &Matrix3<f64>| {
            let mut view = own.fixed_view_mut::<3, 3>(row, column);
            view += block;
        };
        add(0, 0, &(-bd * b));
        add(0, 3, &bd);
        add(3, 0, &bd.transpose());
        add(3, 3, &d);
        self.press[link] += Wrench::force_at(force, &contact.x);
        if contact.turns() {
            // Resistance to rotation, column by column.
            let axes = Matrix3::identity();
            let turning = &contact.turning;
            let resists = Matrix3::from_columns(&[0, 1, 2].map(|k| -turning.resists(n, &axes.column(k).into()) * h));
            let mut view = self.links[link].fixed_view_mut::<3, 3>(0, 0);
            view += resists;
            self.press[link].ang += turning.resists(n, &(turning.spin - turning.turn_offset));
        }
    }

    /// Adds `resists` (kg m^2 or kg) to the implicit resistance of a joint.
    pub(super) fn joint(&mut self, joint: usize, resists: f64) {
        self.joints[joint] += resists;
    }

    /// Replaces the generalised forces `right` by the accelerations; `false` if the factorisation fails.
    pub(super) fn solve(&mut self, robot: &Robot, data: &Data, right: &mut [f64]) -> bool {
        let sound = self.factor.refill(robot, data, &self.links, &self.joints);
        if sound {
            self.factor.solve(robot, data, &self.press, right);
        }
        sound
    }

    /// Acceleration `J qdd` (m/s^2) of a link's point in the last solution.
    pub(super) fn at(&self, link: usize, x: &Vector3<f64>) -> Vector3<f64> {
        self.factor.acceleration(link).at(x)
    }

    /// Angular acceleration `J qdd` (rad/s^2) of a link in the last solution.
    pub(super) fn spin(&self, link: usize) -> Vector3<f64> {
        self.factor.acceleration(link).ang
    }

    /// DoF where the factorisation failed.
    pub(super) fn lost(&self) -> usize {
        self.factor.lost()
    }
}
