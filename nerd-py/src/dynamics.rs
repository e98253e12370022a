//! Mass matrices, Jacobians and inverse dynamics. Velocities, accelerations and forces have the layout of a state's qd.

use nerd_core::dynamics::{Axes, Data};
use nerd_core::nalgebra::{DMatrix, DVector, Vector3};
use nerd_core::robot::FixedFrame;
use nerd_core::velocity::SpatialTwist;
use nerd_sim::prelude::System as Robot;
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};

/// Calls `work` with each state and its row of `beside` (accelerations). Returns an array of `shape` for each state; a
/// single state gives a single array.
pub fn each<'py>(
    py: Python<'py>,
    system: &Robot,
    states: &Bound<'py, PyAny>,
    beside: Option<&Bound<'py, PyAny>>,
    shape: &[usize],
    work: impl Fn(&mut Data, &[f64], &[f64]) -> DMatrix<f64> + Sync,
) -> PyResult<Floats<'py>> {
    let (width, nv) = (system.robot.state_dim(), system.robot.nv());
    let many: Vec<usize> =
        states.cast::<PyUntypedArray>().iter().filter(|a| a.ndim() == 2).map(|a| a.shape()[0]).collect();
    let like = |last: &[usize]| [&many, last].concat();
    let states = numbers::<f64>("states", states, &[&like(&[width])])?;
    let beside = beside.map(|beside| numbers::<f64>("accelerations", beside, &[&like(&[nv])])).transpose()?;
    let found = py.detach(|| {
        let mut data = system.data();
        let all = states.chunks_exact(width).enumerate().map(|(k, state)| {
            let beside = beside.as_ref().map_or(&[][..], |beside| &beside[k * nv..][..nv]);
            // The transpose makes the column-major matrix row-major.
            work(&mut data, state, beside).transpose()
        });
        all.flat_map(|matrix| matrix.data.as_vec().clone()).collect()
    });
    made(py, found, &like(shape))
}

/// The matrix (nv by nv) that maps qd of a state to the local velocities that `nerd_core::dynamics` takes.
fn local(system: &Robot, q: &[f64]) -> DMatrix<f64> {
    let nv = system.robot.nv();
    let mut turn = DMatrix::identity(nv, nv);
    for column in turn.as_mut_slice().chunks_exact_mut(nv.max(1)) {
        SpatialTwist(column).into_local(&system.robot, q);
    }
    turn
}

pub fn mass_matrix(system: &Robot, data: &mut Data, state: &[f64]) -> DMatrix<f64> {
    let (q, turn) = (system.robot.split(state).0, local(system, state));
    turn.transpose() * data.mass_matrix(&system.robot, q) * turn
}

pub fn jacobian(system: &Robot, frame: &FixedFrame, data: &mut Data, state: &[f64]) -> DMatrix<f64> {
    let (q, turn) = (system.robot.split(state).0, local(system, state));
    data.jacobian(&system.robot, q, frame, Axes::World) * turn
}

/// Generalised forces for `rates`, the time derivative of a state's qd. For a free root, the mapped linear rates plus
/// `w x p_dot` are the linear acceleration of the root.
pub fn inverse_dynamics(system: &Robot, data: &mut Data, state: &[f64], rates: &[f64]) -> DMatrix<f64> {
    let (robot, turn) = (&system.robot, local(system, state));
    let (q, qd) = robot.split(state);
    let qd = qd.to_local(robot, q);
    let mut qdd = if rates.is_empty() { DVector::zeros(robot.nv()) } else { &turn * DVector::from_column_slice(rates) };
    if robot.floating() {
        let part = |k: usize| Vector3::from_column_slice(&qd.0[k..k + 3]);
        let mut linear = qdd.fixed_rows_mut::<3>(3);
        linear += part(0).cross(&part(3));
    }
    let gravity = system.spec.gravity.into();
    let forces = turn.transpose() * data.inverse_dynamics(robot, q, &qd, qdd.as_slice(), &gravity);
    DMatrix::from_column_slice(forces.len(), 1, forces.as_slice())
}
