//! Gradients of a frame, for `nerd.torch` and other gradient methods.

use nerd_core::tangent::{by_numbers, numbers_back};
use nerd_sim::prelude::StepError;
use nerd_sim::solver::Slopes;
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};
use crate::error::step;
use crate::simulation::{Inner, Simulation};

/// Arrays of a frame: next states, and gradients with respect to states and torques.
type Back<'py> = (Floats<'py>, Floats<'py>, Floats<'py>);

/// A simulation at temporary states. Its own are put back whatever happens: numpy arrays point at them.
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
    /// Calls `find` with the batch at these states.
    fn at<T>(&mut self, states: Vec<f64>, find: impl FnOnce(&mut nerd_sim::prelude::Simulation) -> T) -> T {
        let own = std::mem::replace(&mut self.simulation.batch.states, states);
        let lent = Lent { own, simulation: &mut self.simulation };
        find(&mut *lent.simulation)
    }
}

/// vjp(simulation, states, tau, by_next=None): the frame from states [n, nq + nv] under torques [n, joints], and its vector-Jacobian
/// product. Returns next states, and gradients with respect to states and torques, from the upstream gradient by_next [n, nq + nv] with
/// respect to the next states (None: zeros). All float64, with respect to the numbers of a state; a quaternion's length has no effect. The
/// simulation is not changed.
///
/// Raises ValueError for a solver without gradients: take "articulated" or a model whose network sees one frame.
#[pyfunction]
#[pyo3(signature = (simulation, states, tau, by_next=None))]
pub fn vjp<'py>(
    simulation: &Simulation,
    py: Python<'py>,
    states: &Bound<'py, PyAny>,
    tau: &Bound<'py, PyAny>,
    by_next: Option<&Bound<'py, PyAny>>,
) -> PyResult<Back<'py>> {
    let ([joints, width], n) = (simulation.widths(), simulation.n);
    let mut states = numbers::<f64>("states", states, &[&[n, width]])?;
    let tau = numbers::<f64>("tau", tau, &[&[n, joints]])?;
    let by_next = by_next.map(|by| numbers::<f64>("by_next", by, &[&[n, width]])).transpose()?;
    let robot = &simulation.system.robot;
    let lengths = units(robot.floating(), &mut states, width);
    let found = simulation.with(py, |inner| {
        inner.at(states, |simulation| -> Result<(Slopes, Vec<f64>), StepError> {
            let (batch, solver) = (&simulation.batch, &mut simulation.solver);
            let mut slopes = solver.back(batch, &tau, 0, &[])?;
            let Some(by_next) = &by_next else { return Ok((slopes, vec![0.0; n * width])) };
            let mut upstream = vec![0.0; n * 2 * robot.nv()];
            let rows = upstream.chunks_exact_mut(2 * robot.nv()).zip(slopes.next.chunks_exact(width));
            rows.zip(by_next.chunks_exact(width)).for_each(|((slope, next), by)| numbers_back(robot, next, by, slope));
            slopes = solver.back(batch, &tau, 1, &upstream)?;
            let rows = slopes.states.chunks_exact(2 * robot.nv()).zip(batch.states.chunks_exact(width));
            let by_states = rows.flat_map(|(slope, state)| by_numbers(robot, state, slope)).collect();
            Ok((slopes, by_states))
        })
    });
    let (slopes, mut by_states) = found?.map_err(step)?;
    for (row, length) in by_states.chunks_exact_mut(width).zip(lengths) {
        row[3..7].iter_mut().for_each(|by| *by /= length);
    }
    let by_torques = if slopes.torques.is_empty() { vec![0.0; n * joints] } else { slopes.torques };
    Ok((made(py, slopes.next, &[n, width])?, made(py, by_states, &[n, width])?, made(py, by_torques, &[n, joints])?))
}

/// linearise(simulation, tau): the next frame to first order, in tangent spaces of 2 nv numbers, pose then velocities (for a free root a
/// rotation vector, a translation and velocities in its own axes): A [n, 2 nv, 2 nv] and B [n, 2 nv, joints], float64.
#[pyfunction]
pub fn linearise<'py>(simulation: &Simulation, py: Python<'py>, tau: &Bound<'py, PyAny>) -> PyResult<(Floats<'py>, Floats<'py>)> {
    let ([joints, _], n, size) = (simulation.widths(), simulation.n, 2 * simulation.system.robot.nv());
    let tau = numbers::<f64>("tau", tau, &[&[n, joints]])?;
    let slopes = simulation.with(py, |inner| inner.simulation.solver.linearise(&inner.simulation.batch, &tau))?.map_err(step)?;
    Ok((made(py, slopes.states, &[n, size, size])?, made(py, slopes.torques, &[n, size, joints])?))
}

/// Normalises quaternions of free roots; returns their lengths.
fn units(floating: bool, states: &mut [f64], width: usize) -> Vec<f64> {
    let rows = states.chunks_exact_mut(width).filter(|_| floating);
    let unit = |row: &mut [f64]| {
        let length = row[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
        // Zeros are left for the solver to refuse.
        let length = if length > 0.0 { length } else { 1.0 };
        row[3..7].iter_mut().for_each(|x| *x /= length);
        length
    };
    rows.map(unit).collect()
}
