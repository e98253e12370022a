//! Working memory of the implicit step.

use nalgebra::DMatrix;

use super::{along::Tree, touch::Touch};
use crate::prelude::*;

#[derive(Default)]
pub(super) struct Touches {
    pub(super) touches: Vec<Touch>,
    pub(super) columns: Vec<(usize, Vector3<f64>)>,
    /// w of every point with every collider, of every joint's limit and of every drive, found once a frame.
    pub(super) weights: Vec<Option<f64>>,
    /// Damping of each joint: its own, or what its spring asks for where the substep is too long to follow it.
    pub(super) braked: Vec<f64>,
    /// What the joints' own dampers and springs resist with, their shares of `h d` and `h^2 k`.
    pub(super) shares: Vec<f64>,
    /// The substep for which they were found (s); 0: for none.
    pub(super) shared: f64,
    /// Whether the substep's mass matrix alone is inverted.
    pub(super) plain: bool,
    /// The springs' torques in the middle of the substep.
    pub(super) pull: Vec<f64>,
    /// Whether contacts and limits take the means over a substep, whatever its length: they ring, and give no energy.
    pub(super) even: bool,
    /// Whether something was met in the frame that may give energy.
    pub(super) eventful: bool,
    /// Work (J) of the drives in the frame, and its size either way.
    pub(super) work: (f64, f64),
    pub(super) mass: DMatrix<f64>,
    /// Where the tree is too deep for the matrix.
    pub(super) tree: Option<Tree>,
    /// Velocity in the middle of the substep, as the bias sees it, and the rate of change of velocities in the last one.
    pub(super) middle: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) right: Vec<f64>,
    pub(super) before: Vec<f64>,
}

impl Touches {
    pub(super) fn new(system: &System) -> Self {
        let robot = &system.robot;
        let (points, joints, nv) = (robot.contact_points.len(), robot.joint_count(), robot.nv());
        Self {
            touches: Vec::with_capacity(points + 3 * joints),
            columns: Vec::with_capacity(points * nv),
            weights: vec![None; points + 2 * joints],
            braked: vec![0.0; joints],
            shares: vec![0.0; joints],
            pull: vec![0.0; joints],
            mass: DMatrix::zeros(nv, nv),
            tree: Tree::new(system),
            middle: vec![0.0; nv],
            rate: vec![0.0; nv],
            right: vec![0.0; nv],
            before: vec![0.0; robot.nq()],
            ..Self::default()
        }
    }

    /// Adds this share of the contacts' forces to those of their points.
    pub(super) fn tell(&self, share: f64, forces: &mut [Vector3<f64>]) {
        for touch in &self.touches {
            if let Touch::Contact(contact) = touch {
                forces[contact.point] += contact.force * share;
            }
        }
    }

    /// Adds the drives' work in a substep that begins at velocities `qd`.
    pub(super) fn drive(&mut self, dofs: usize, h: f64, qd: &[f64]) {
        for touch in &self.touches {
            let Touch::Drive { spring, held, .. } = touch else { continue };
            let change = h * self.rate[dofs + spring.joint];
            let force = held.unwrap_or_else(|| spring.force(change, h));
            let work = force * h * (qd[dofs + spring.joint] + 0.5 * change);
            self.work = (self.work.0 + work, self.work.1 + work.abs());
        }
    }

    /// A frame begins; room for every point to touch every collider.
    pub(super) fn begin(&mut self, robot: &Robot, scene: &Scene) {
        let (pairs, joints) = (robot.contact_points.len() * scene.colliders.len(), robot.joint_count());
        self.shared = 0.0;
        self.weights.clear();
        self.weights.resize(pairs + 2 * joints, None);
        self.touches.clear();
        self.touches.reserve(pairs + 3 * joints);
        self.columns.clear();
        self.columns.reserve(pairs * robot.nv());
    }
}
