//! Working memory of the implicit step. `find.rs` fills in the touches; `touch.rs` has their forces.

use nalgebra::{DMatrix, SVector};

use super::{along::Tree, fast::fast_moves, touch::Touch};
use crate::prelude::*;

#[derive(Default)]
pub(super) struct Touches {
    pub(super) touches: Vec<Touch>,
    pub(super) columns: Vec<(usize, Vector3<f64>)>,
    /// Inverse effective mass w of every pair of point and collider, every joint's limit and every drive, computed once
    /// a frame.
    pub(super) weights: Vec<Option<f64>>,
    /// By pair of point and collider: w across the normal (1/kg), summed over both directions. Second: the contact's
    /// wrench (N m, N) in the substep before.
    pub(super) slides: Vec<(f64, Wrench)>,
    /// Damping of each joint (N m s/rad or N s/m): its own, or more where its spring is too stiff for the substep.
    pub(super) damping_used: Vec<f64>,
    /// Implicit resistance of the joints' own dampers and springs, `theta h d + theta h^2 k`.
    pub(super) shares: Vec<f64>,
    /// Substep (s) that the present `damping_used` and `shares` are for; 0: none yet.
    pub(super) damped_h: f64,
    /// Whether the substep's mass matrix without touches has been factorised.
    pub(super) factorised: bool,
    /// Torques of the joints' springs at the middle of the substep.
    pub(super) pull: Vec<f64>,
    /// Whether contacts and limits have theta 1/2 (springs 1/4) however long the substep. A spring too stiff for the
    /// substep then oscillates, but gains no energy.
    pub(super) mean_theta: bool,
    /// Whether an event of the frame may have gained energy (`energy.rs`).
    pub(super) may_gain_energy: bool,
    /// Whether a sticking contact still creeps after the last solve (`stick.rs`).
    pub(super) creeps: bool,
    /// By joint: turn (rad) or travel (m) in a substep above which the frame may gain energy (`energy.rs`).
    pub(super) fast_moves: Vec<f64>,
    /// Factor on the frame's final velocities that removes gained energy (`energy.rs`).
    pub(super) velocity_factor: f64,
    /// Work (J) of the drives in the frame, and the sum of its absolute values.
    pub(super) work: (f64, f64),
    pub(super) mass: DMatrix<f64>,
    /// Solver along the tree; `None` where the matrix is factorised instead.
    pub(super) tree: Option<Tree>,
    /// Velocity at the middle of the substep, for the bias forces, and the latest rate of change of the velocities.
    pub(super) middle: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) right: Vec<f64>,
    /// By DoF: columns of the Jacobian of a contact's point, and of a joint.
    pub(super) point_columns: Vec<Vector3<f64>>,
    pub(super) joint_column: Vec<SVector<f64, 1>>,
    /// Coordinates at the substep's start.
    pub(super) before: Vec<f64>,
}

impl Touches {
    pub(super) fn new(system: &System) -> Self {
        let robot = &system.robot;
        let points = robot.contact_points.len();
        let joints = robot.joint_count();
        let nv = robot.nv();
        Self {
            touches: Vec::with_capacity(points + 3 * joints),
            columns: Vec::with_capacity(points * nv),
            weights: vec![None; points + 2 * joints],
            slides: Vec::with_capacity(points),
            damping_used: vec![0.0; joints],
            shares: vec![0.0; joints],
            pull: vec![0.0; joints],
            fast_moves: fast_moves(robot),
            mass: DMatrix::zeros(nv, nv),
            tree: Tree::new(system),
            middle: vec![0.0; nv],
            rate: vec![0.0; nv],
            right: vec![0.0; nv],
            point_columns: vec![Vector3::zeros(); nv],
            joint_column: vec![SVector::zeros(); nv],
            before: vec![0.0; robot.nq()],
            ..Self::default()
        }
    }

    /// Adds the contacts' forces, times `share`, to the forces on their points.
    pub(super) fn add_forces(&self, share: f64, forces: &mut [Vector3<f64>]) {
        for touch in &self.touches {
            if let Touch::Contact(contact) = touch {
                forces[contact.point] += contact.force * share;
            }
        }
    }

    /// Stores the contacts' wrenches, which friction holds with in the next substep.
    pub(super) fn keep_wrenches(&mut self) {
        for touch in &self.touches {
            if let Touch::Contact(contact) = touch {
                self.slides[contact.index].1 = contact.wrench();
            }
        }
    }

    /// Adds the drives' work over a substep that begins at velocities `qd`.
    pub(super) fn add_work(&mut self, dofs: usize, h: f64, qd: &[f64]) {
        for touch in &self.touches {
            let Touch::Drive { spring, held, .. } = touch else { continue };
            let change = h * self.rate[dofs + spring.joint];
            let force = held.unwrap_or_else(|| spring.force(change, h));
            let work = force * h * (qd[dofs + spring.joint] + 0.5 * change);
            self.work = (self.work.0 + work, self.work.1 + work.abs());
        }
    }

    /// Begins a frame, with room for every point to touch every collider.
    pub(super) fn begin(&mut self, robot: &Robot, scene: &Scene) {
        let pairs = robot.contact_points.len() * scene.colliders.len();
        let joints = robot.joint_count();
        self.damped_h = 0.0;
        self.weights.clear();
        self.weights.resize(pairs + 2 * joints, None);
        self.slides.clear();
        self.slides.resize(pairs, (0.0, Wrench::default()));
        self.touches.clear();
        self.touches.reserve(pairs + 3 * joints);
        self.columns.clear();
        self.columns.reserve(pairs * robot.nv());
    }
}
