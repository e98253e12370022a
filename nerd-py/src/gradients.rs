//! Gradients of a frame, for `nerd.torch` and other gradient methods.

use nerd_core::tangent::{by_numbers, numbers_back};
use nerd_sim::prelude::StepError;
use nerd_sim::solver::Gradients;
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};
use crate::error::step;
use crate::simulation::{Inner, Simulation};

/// Arrays of the next states, of the gradient with respect to states, and of the gradient with respect to torques.
type Back<'py> = (Floats<'py>, Floats<'py>, Floats<'py>);

/// A simulation at temporary states. Dropping it restores the simulation's own states, since numpy arrays point at
/// their memory.
struct Lent<'a> {
    own: Vec<f64>,
    simulation: &'a mut nerd_sim::prelude::Simulation,
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        std::mem::swap(&mut self.simulation.batch.states, &mut self.own);
    }
}

impl Inner {
    /// Calls `find` with the simulation at `states`, then restores the simulation's own states.
    fn at<T>(&mut self, states: Vec<f64>, find: impl FnOnce(&mut nerd_sim::prelude::Simulation) -> T) -> T {
        let own = std::mem::replace(&mut self.simulation.batch.states, states);
        let lent = Lent { own, simulation: &mut self.simulation };
        find(&mut *lent.simulation)
    }
}

/// vjp(simulation, states, tau, grad_next=None): steps one frame and computes its vector-Jacobian product. The frame
/// starts from states [n, nq + nv] and is under torques tau [n, joints]. The upstream gradient grad_next [n, nq + nv]
/// is with respect to the next states; None means zeros. Returns the next states, the gradient with respect to states,
/// and that with respect to tau. All arrays are float64. Gradients are with respect to the numbers of a state; a
/// quaternion's length has no effect. The simulation is not changed.
///
/// Raises ValueError for a solver without gradients. "articulated" has gradients, and so has a model whose network sees
/// one frame.
#[pyfunction]
#[pyo3(signature = (simulation, states, tau, grad_next=None))]
pub fn vjp<'py>(
    simulation: &Simulation,
    py: Python<'py>,
    states: &Bound<'py, PyAny>,
    tau: &Bound<'py, PyAny>,
    grad_next: Option<&Bound<'py, PyAny>>,
) -> PyResult<Back<'py>> {
    let ([joints, width], n) = (simulation.widths(), simulation.n);
    let mut states = numbers::<f64>("states", states, &[&[n, width]])?;
    let tau = numbers::<f64>("tau", tau, &[&[n, joints]])?;
    let grad_next = grad_next.map(|by| numbers::<f64>("grad_next", by, &[&[n, width]])).transpose()?;
    let robot = &simulation.system.robot;
    let lengths = units(robot.floating(), &mut states, width);
    let found = simulation.with(py, |inner| {
        inner.at(states, |simulation| -> Result<(Gradients, Vec<f64>), StepError> {
            let (batch, solver) = (&simulation.batch, &mut simulation.solver);
            let mut gradients = solver.vjp(batch, &tau, 0, &[])?;
            let Some(grad_next) = &grad_next else { return Ok((gradients, vec![0.0; n * width])) };
            let mut upstream = vec![0.0; n * 2 * robot.nv()];
            let rows = upstream.chunks_exact_mut(2 * robot.nv()).zip(gradients.next.chunks_exact(width));
            rows.zip(grad_next.chunks_exact(width))
                .for_each(|((gradient, next), by)| numbers_back(robot, next, by, gradient));
            gradients = solver.vjp(batch, &tau, 1, &upstream)?;
            let rows = gradients.states.chunks_exact(2 * robot.nv()).zip(batch.states.chunks_exact(width));
            let by_states = rows.flat_map(|(gradient, state)| by_numbers(robot, state, gradient)).collect();
            Ok((gradients, by_states))
        })
    });
    let (gradients, mut by_states) = found?.map_err(step)?;
    for (row, length) in by_states.chunks_exact_mut(width).zip(lengths) {
        row[3..7].iter_mut().for_each(|by| *by /= length);
    }
    let by_torques = if gradients.torques.is_empty() { vec![0.0; n * joints] } else { gradients.torques };
    Ok((made(py, gradients.next, &[n, width])?, made(py, by_states, &[n, width])?, made(py, by_torques, &[n, joints])?))
}

/// linearise(simulation, tau): linearises a frame from the present states under torques tau [n, joints]. Returns the
/// Jacobians A [n, 2 nv, 2 nv] with respect to states, and B [n, 2 nv, joints] with respect to tau, in float64. States
/// are in tangent spaces of 2 nv numbers: pose, then velocities. For a free root these are a rotation vector (rad), a
/// translation (m), and velocities in root axes (rad/s, m/s).
#[pyfunction]
pub fn linearise<'py>(
    simulation: &Simulation,
    py: Python<'py>,
    tau: &Bound<'py, PyAny>,
) -> PyResult<(Floats<'py>, Floats<'py>)> {
    let ([joints, _], n, size) = (simulation.widths(), simulation.n, 2 * simulation.system.robot.nv());
    let tau = numbers::<f64>("tau", tau, &[&[n, joints]])?;
    let gradients =
        simulation.with(py, |inner| inner.simulation.solver.linearise(&inner.simulation.batch, &tau))?.map_err(step)?;
    Ok((made(py, gradients.states, &[n, size, size])?, made(py, gradients.torques, &[n, size, joints])?))
}

/// Normalises the quaternions of free roots in `states`; returns their former lengths.
fn units(floating: bool, states: &mut [f64], width: usize) -> Vec<f64> {
    let rows = states.chunks_exact_mut(width).filter(|_| floating);
    let unit = |row: &mut [f64]| {
        let length = row[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
        // A quaternion of zeros stays as it is, and the solver refuses it.
        let length = if length > 0.0 { length } else { 1.0 };
        row[3..7].iter_mut().for_each(|x| *x /= length);
        length
    };
    rows.map(unit).collect()
}
