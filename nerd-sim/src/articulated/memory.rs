//! Working memory of the backward pass through a frame.

use nalgebra::DMatrix;
use nerd_core::dynamics::Adjoint;

use super::kept::Kept;
use crate::prelude::*;

pub(super) struct Memory {
    pub(super) kept: Kept,
    pub(super) adjoint: Adjoint,
    /// Twists of links at a substep's start, and their accelerations caused by `qdd`.
    pub(super) starts: Vec<Motion>,
    pub(super) quickened: Vec<Motion>,
    pub(super) columns: Vec<(usize, Vector3<f64>)>,
    pub(super) by_middle: Vec<f64>,
    /// `(dR/da)^T`: transposed Jacobian of the solve's residual R with respect to a substep's acceleration a.
    pub(super) matrix: DMatrix<f64>,
    pub(super) flight: Flight,
}

impl Memory {
    pub(super) fn new(robot: &Robot) -> Self {
        let n = robot.links.len();
        let nv = robot.nv();
        Self {
            kept: Kept::default(),
            adjoint: Adjoint::new(robot),
            starts: vec![Motion::default(); n],
            quickened: vec![Motion::default(); n],
            columns: Vec::new(),
            by_middle: vec![0.0; nv],
            matrix: DMatrix::zeros(nv, nv),
            flight: Flight::new(robot),
        }
    }
}

/// Working memory of the backward pass through Runge-Kutta's substeps.
pub(super) struct Flight {
    pub(super) end: Vec<f64>,
    /// Gradients with respect to the state before a substep, the state after it, a stage's state and a stage's rate.
    /// Here a quaternion counts as four numbers.
    pub(super) by_state: Vec<f64>,
    pub(super) by_end: Vec<f64>,
    pub(super) by_stage: Vec<f64>,
    pub(super) by_rate: Vec<f64>,
    pub(super) virtuals: Vec<f64>,
    pub(super) qdd: Vec<f64>,
}

impl Flight {
    pub(super) fn new(robot: &Robot) -> Self {
        let [end, by_state, by_end, by_stage, by_rate] = [(); 5].map(|()| vec![0.0; robot.state_dim()]);
        let [virtuals, qdd] = [(); 2].map(|()| vec![0.0; robot.nv()]);
        Self { end, by_state, by_end, by_stage, by_rate, virtuals, qdd }
    }
}
