//! The implicit step's equations along the tree, in O(n), for robots whose chains are long: cables, hands, humanoids.
//!
//! A touch resists the motion of one link or one joint alone. So `(M + h sum J^T D J) qdd = right` is solved as forward dynamics are, with
//! `h J_x^T D J_x` beside the inertia of the link that a point is on and `h d` beside the armature of a joint ([`TreeFactor`]).

use nalgebra::Matrix6;
use nerd_core::dynamics::TreeFactor;

use super::touch::Contact;
use crate::prelude::*;

/// From so many products a DoF of the matrix's factor on, the tree is taken. Chosen by the clock, between quadrupeds with legs of three joints,
/// which gain little or lose, and humanoids and chains of twenty hinges, which gain.
const DEEP: usize = 60;
/// So many springs are a chain that may whip, however short it is.
const CHAIN: usize = 3;

/// Whether implicit steps of a robot are solved along its tree, and whips looked for; otherwise by its matrix.
pub fn along(robot: &Robot) -> bool {
    let above: Vec<usize> = nerd_core::dynamics::Factor::new(robot).above().map(|p| p.map_or(usize::MAX, |p| p)).collect();
    let mut depths: Vec<usize> = Vec::new();
    above.iter().for_each(|p| depths.push(depths.get(*p).map_or(1, |d| d + 1)));
    chained(robot) || depths.iter().map(|d| d * d).sum::<usize>() >= DEEP * robot.nv()
}

/// Whether a robot is such a chain.
pub(super) fn chained(robot: &Robot) -> bool {
    robot.joints().filter(|j| j.stiffness > 0.0).count() >= CHAIN
}

pub(super) struct Tree {
    factor: TreeFactor,
    /// What resists beside the inertias of links, and beside those of joints.
    links: Vec<Matrix6<f64>>,
    joints: Vec<f64>,
    press: Vec<Wrench>,
}

impl Tree {
    /// None for a robot that the matrix is faster for, or that has more in its matrix than its tree says.
    pub(super) fn new(system: &System) -> Option<Self> {
        let robot = &system.robot;
        let (links, joints) = (robot.links.len(), robot.joint_count());
        (along(robot) && system.stand_ins.is_empty()).then(|| TreeFactor::new(robot)).flatten().map(|factor| Self {
            factor,
            links: vec![Matrix6::zeros(); links],
            joints: vec![0.0; joints],
            press: vec![Wrench::default(); links],
        })
    }

    /// The inverse of the mass matrix alone, for [`Tree::ease`] and [`Tree::eased`].
    pub(super) fn plain(&mut self, robot: &Robot, data: &Data) -> bool {
        let sound = self.factor.refill(robot, data, &[], &[]);
        if sound {
            self.factor.spread(robot, data);
        }
        sound
    }

    /// w of a joint.
    pub(super) fn ease(&self, robot: &Robot, joint: usize) -> f64 {
        self.factor.ease(robot, joint + usize::from(robot.floating()))
    }

    /// w of a contact along its normal.
    pub(super) fn eased(&self, contact: &Contact) -> f64 {
        let Contact { normal, x, link, .. } = contact;
        normal.dot(&self.factor.eased(*link, &Wrench::force_at(*normal, x)).at(x))
    }

    /// Begins a pass, in which joints resist with so much by themselves.
    pub(super) fn clear(&mut self, shares: &[f64]) {
        self.links.fill(Matrix6::zeros());
        self.joints.copy_from_slice(shares);
        self.press.fill(Wrench::default());
    }

    /// A point that pushes and resists with `h D`, `D = (along - across) n n^T + across`.
    pub(super) fn point(&mut self, contact: &Contact, h: f64) {
        let (force, along, across) = contact.push(h);
        let (link, n, b) = (contact.link, &contact.normal, contact.x.cross_matrix());
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
            // What resists a turn about each axis.
            let axes = Matrix3::identity();
            let resists = Matrix3::from_columns(&[0, 1, 2].map(|k| -contact.turn_torque(&axes.column(k).into()) * h));
            let mut view = self.links[link].fixed_view_mut::<3, 3>(0, 0);
            view += resists;
            self.press[link].ang += contact.turn_torque(&contact.spin);
        }
    }

    /// A joint that resists with so much.
    pub(super) fn joint(&mut self, joint: usize, resists: f64) {
        self.joints[joint] += resists;
    }

    /// Replaces `right` by the solution; `false` if there is none.
    pub(super) fn solve(&mut self, robot: &Robot, data: &Data, right: &mut [f64]) -> bool {
        let sound = self.factor.refill(robot, data, &self.links, &self.joints);
        if sound {
            self.factor.solve(robot, data, &self.press, right);
        }
        sound
    }

    /// The change of velocity of a point in a second.
    pub(super) fn at(&self, link: usize, x: &Vector3<f64>) -> Vector3<f64> {
        self.factor.acceleration(link).at(x)
    }

    /// The change of angular velocity of a link in a second.
    pub(super) fn spin(&self, link: usize) -> Vector3<f64> {
        self.factor.acceleration(link).ang
    }

    /// The DoF at which there was no solution.
    pub(super) fn lost(&self) -> usize {
        self.factor.lost()
    }
}
