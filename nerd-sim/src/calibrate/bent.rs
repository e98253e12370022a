//! Gradient of the objective with respect to the parameters, by forward sensitivities of rollouts. The sensitivity S of
//! the state follows `S' = A S + P`, with a frame's Jacobians A (previous state) and P (parameters). Descent
//! (Levenberg-Marquardt within bounds) goes from short to long rollouts. Over a few frames the objective is smooth, and
//! its minimum lies near the minimum over long rollouts.

use std::ops::AddAssign;

use nalgebra::{DMatrix, DVector};
use nerd_core::tangent::difference;
use rayon::prelude::*;

use super::parameter::{CalibrateError, Parameter, What};
use super::subject::{Engine, Subject};
use super::trial::{Distance, Trial};
use crate::{log::turned, prelude::*};

/// Step of the scaled parameters for central differences of starts.
const DIFFERENCE_STEP: f64 = 1e-5;
/// Norm of the sensitivity (units per unit change of all scaled parameters) that halves a frame's weight. After a
/// chaotic bounce, frames carry no information.
const HALVING_SENSITIVITY: f64 = 150.0;
/// Largest sensitivity of a rollout; beyond it the rollout ends, to avoid overflow.
const MAX_SENSITIVITY: f64 = 1e9;
/// Differences from the measurement below this many units (nominal distances) count quadratically.
const QUADRATIC_RANGE: f64 = 0.1;

/// Gradient of the objective with respect to the scaled parameters (0 to 1 between their bounds), and its Gauss-Newton
/// Hessian. A distance d counts as d^2 / d (iteratively reweighted least squares).
pub(super) struct Bent {
    pub(super) gradient: DVector<f64>,
    pub(super) curvature: DMatrix<f64>,
}

impl Bent {
    fn none(p: usize) -> Self {
        Self { gradient: DVector::zeros(p), curvature: DMatrix::zeros(p, p) }
    }

    /// Adds a difference (normalised by `unit`) and its sensitivities. A part without a unit adds nothing, as in the
    /// objective.
    fn add(&mut self, apart: &[f64], by: DMatrix<f64>, unit: f64, share: f64) {
        if !unit.is_normal() {
            return;
        }
        let apart = DVector::from_column_slice(apart);
        let far = by.norm() / (HALVING_SENSITIVITY * unit);
        let weight = share / ((1.0 + far * far) * unit * apart.norm().max(QUADRATIC_RANGE * unit));
        self.gradient.gemv_tr(weight, &by, &apart, 1.0);
        self.curvature.gemm_tr(weight, &by, &by, 1.0);
    }
}

impl Subject {
    /// Gradient and Gauss-Newton Hessian at `values`, where `self` has nominal parameters; `None` if the solver has no
    /// gradients.
    pub(super) fn bent(
        &self,
        parameters: &[Parameter],
        values: &[f64],
        trials: &[Trial],
        unit: &Distance,
    ) -> Result<Option<Bent>, CalibrateError> {
        let Engine::Articulated(config) = self.engine else { return Ok(None) };
        let at = Point::new(self, parameters, values, unit.parts())?;
        let begin = || {
            let own = &at.own;
            (Articulated::new(config), Batch::new(&own.system, &own.scene, 1), Data::new(&own.system.robot))
        };
        let one = |(solver, batch, data): &mut (Articulated, Batch, Data), trial: &Trial| {
            at.rollout(solver, batch, data, trial)
        };
        let all: Vec<Option<Bent>> = trials.par_iter().map_init(begin, one).collect();
        let sum = |a: Bent, b: Bent| Bent { gradient: a.gradient + b.gradient, curvature: a.curvature + b.curvature };
        Ok(all.into_iter().collect::<Option<Vec<_>>>().map(|all| {
            let mut bent = all.into_iter().fold(Bent::none(parameters.len()), sum);
            // `bent` sums over trials and parts, while the objective is their mean.
            let share = (trials.len() * at.unit.iter().filter(|unit| **unit > 0.0).count()) as f64;
            for (k, (parameter, value)) in parameters.iter().zip(values).enumerate() {
                bent.gradient[k] += share * parameter.pull(*value)[1];
                bent.curvature[(k, k)] += share * 2.0 * parameter.weight;
            }
            bent
        }))
    }
}

/// A subject at given values of parameters, with all that its rollouts' sensitivities need.
struct Point<'a> {
    own: Subject,
    parameters: &'a [Parameter],
    /// Derivative of each parameter's value with respect to its scaled parameter; `by`: of the numbers of robot and
    /// scene.
    by_place: Vec<f64>,
    by: DMatrix<f64>,
    /// For each parameter, the subject with a slightly smaller and a slightly larger value.
    sides: Vec<[Subject; 2]>,
    /// Nominal distances of position (m), rotation (rad) and joints (rad or m), which normalise differences.
    unit: [f64; 3],
    identity: Vec<f64>,
}

impl<'a> Point<'a> {
    fn new(
        nominal: &Subject,
        parameters: &'a [Parameter],
        values: &[f64],
        unit: [f64; 3],
    ) -> Result<Self, CalibrateError> {
        let own = nominal.with(parameters, values)?;
        let rows = 2 * own.system.robot.nv();
        let by_place: Vec<f64> = parameters.iter().zip(values).map(|(p, v)| p.by_place(*v)).collect();
        let by = nominal
            .numbers_by(parameters, values)?
            .into_iter()
            .zip(&by_place)
            .map(|(by, place)| DVector::from_vec(by) * *place);
        let by = DMatrix::from_columns(&by.collect::<Vec<_>>());
        let side = |k: usize, size: f64| {
            let mut values = values.to_vec();
            values[k] += size * by_place[k];
            nominal.with(parameters, &values)
        };
        let sides = (0..parameters.len())
            .map(|k| Ok([side(k, -DIFFERENCE_STEP)?, side(k, DIFFERENCE_STEP)?]))
            .collect::<Result<Vec<_>, CalibrateError>>()?;
        let identity: Vec<f64> = (0..rows * rows).map(|k| f64::from(k % (rows + 1) == 0)).collect();
        Ok(Self { own, parameters, by_place, by, sides, unit, identity })
    }

    /// Gradient and Hessian of one trial; `None` if the solver refuses gradients.
    fn rollout(&self, solver: &mut Articulated, batch: &mut Batch, data: &mut Data, trial: &Trial) -> Option<Bent> {
        let own = &self.own;
        let robot = &self.own.system.robot;
        let rows = 2 * robot.nv();
        let mut bent = Bent::none(self.parameters.len());
        batch.reset(0, &own.start(trial, data));
        let mut s = self.start(trial, data);
        let share = 1.0 / trial.measured.len() as f64;
        for (frame, measured) in trial.measured[1..].iter().enumerate() {
            let asked = trial.asked(frame);
            let acting = own.late(&asked);
            let gradients = match solver.back_by_numbers(batch, &acting, rows, &self.identity) {
                Ok(found) => found,
                Err(StepError::Refused(_)) => return None,
                // A rollout that cannot continue adds no further frames.
                Err(_) => break,
            };
            s = DMatrix::from_row_slice(rows, rows, &gradients.states) * s
                + DMatrix::from_row_slice(rows, self.by.nrows(), &gradients.numbers) * &self.by;
            self.add_torques(&mut s, &asked, &acting, &gradients.torques);
            // Frames with such sensitivities have negligible weight.
            if !s.iter().all(|x| x.abs() < MAX_SENSITIVITY) {
                break;
            }
            batch.reset(0, &gradients.next);
            let mut q = gradients.next[..robot.nq()].to_vec();
            own.shift(&mut q, -1.0);
            self.compare(&mut bent, measured, &q, &s, share);
        }
        Some(bent)
    }

    /// Sensitivities of a trial's start state, with one column per parameter.
    fn start(&self, trial: &Trial, data: &mut Data) -> DMatrix<f64> {
        let robot = &self.own.system.robot;
        let mut s = DMatrix::zeros(2 * robot.nv(), self.parameters.len());
        for (k, [low, high]) in self.sides.iter().enumerate() {
            let apart = difference(robot, &low.start(trial, data), &high.start(trial, data));
            s.set_column(k, &(DVector::from_vec(apart) / (2.0 * DIFFERENCE_STEP)));
        }
        s
    }

    /// Adds the sensitivities to parameters that change a frame's torques.
    fn add_torques(&self, s: &mut DMatrix<f64>, asked: &[&[f64]; 3], acting: &[f64], by_torques: &[f64]) {
        let own = &self.own;
        let by_torques = DMatrix::from_row_slice(s.nrows(), acting.len(), by_torques);
        for (k, parameter) in self.parameters.iter().enumerate() {
            let change = match parameter.what {
                What::Delay => {
                    // The torque is linear in the delay between whole frames; at a whole frame, take the derivative
                    // toward smaller delays.
                    let last = (own.delay.ceil() as usize).clamp(1, asked.len() - 1);
                    let ways = asked[last].iter().zip(asked[last - 1]).zip(&own.strength);
                    let later = ways.map(|((before, now), factor)| (before - now) * factor);
                    &by_torques * DVector::from_iterator(acting.len(), later)
                }
                What::Strength(joint) => by_torques.column(joint) * (acting[joint] / own.strength[joint]),
                _ => continue,
            };
            s.column_mut(k).add_assign(&(change * self.by_place[k]));
        }
    }

    /// Adds the differences of a frame's pose `q` from the measured one, given the sensitivities `s`.
    fn compare(&self, bent: &mut Bent, measured: &[f64], q: &[f64], s: &DMatrix<f64>, share: f64) {
        let robot = &self.own.system.robot;
        let unit = self.unit;
        if robot.floating() {
            let (r, from) = (quaternion(&q[3..7]), quaternion(&measured[3..7]));
            let way = r.inverse_transform_vector(&(vector(q) - vector(measured)));
            bent.add(way.as_slice(), s.rows(3, 3).into_owned(), unit[0], share);
            bent.add((from.inverse() * r).scaled_axis().as_slice(), s.rows(0, 3).into_owned(), unit[1], share);
        }
        let joints = turned(robot, measured, q);
        let share = share / joints.len().max(1) as f64;
        for (i, apart) in joints.iter().enumerate() {
            let mut by = s.rows(robot.root_dofs() + i, 1).into_owned();
            let zeros = self.parameters.iter().enumerate().filter(|(_, p)| p.what == What::Zero(i));
            zeros.for_each(|(k, _)| by[k] -= self.by_place[k]);
            bent.add(&[*apart], by, unit[2], share);
        }
    }
}

/// Initial and least damping of a Levenberg-Marquardt step, as a share of the curvature.
const DAMPING: [f64; 2] = [1e-2, 1e-4];
/// Share of the mean curvature that is added, times the damping, to all parameters, including those without curvature.
const RIDGE: f64 = 0.01;
/// Longest step, in scaled parameters.
const MAX_STEP: f64 = 0.2;
/// Least relative decrease of the objective in a round for another round to follow; `MAX_ROUNDS`: maximum number of
/// rounds.
const MIN_GAIN: f64 = 0.001;
const MAX_ROUNDS: usize = 12;

/// The values after a damped Gauss-Newton step; `None` if the matrix is not positive definite.
fn moved(parameters: &[Parameter], values: &[f64], bent: &Bent, damping: f64) -> Option<Vec<f64>> {
    let mut h = bent.curvature.clone();
    let mut g = bent.gradient.clone();
    let n = values.len();
    let ridge = RIDGE * h.trace() / n as f64;
    let x: Vec<f64> = parameters.iter().zip(values).map(|(p, v)| p.place(*v)).collect();
    for k in 0..n {
        h[(k, k)] += damping * (h[(k, k)] + ridge);
        // A parameter at a bound stays there if its step would leave the bounds.
        if x[k] <= 0.0 && g[k] > 0.0 || x[k] >= 1.0 && g[k] < 0.0 {
            h.row_mut(k).fill(0.0);
            h.column_mut(k).fill(0.0);
            (h[(k, k)], g[k]) = (1.0, 0.0);
        }
    }
    let step = h.cholesky()?.solve(&g);
    let cut = (MAX_STEP / step.amax()).min(1.0);
    Some(parameters.iter().zip(&x).zip(step.iter()).map(|((p, x), s)| p.at(x - cut * s)).collect())
}

/// Descends from `values` while the objective improves and the budget allows. Returns the objective at the final
/// `values`; `None` without gradients.
pub(super) fn descend(
    parameters: &[Parameter],
    values: &mut Vec<f64>,
    may: impl Fn() -> bool,
    worth: impl Fn(&[f64]) -> Result<f64, CalibrateError>,
    bent: impl Fn(&[f64]) -> Result<Option<Bent>, CalibrateError>,
) -> Result<Option<f64>, CalibrateError> {
    let mut best = worth(values)?;
    let mut damping = DAMPING[0];
    for _ in 0..MAX_ROUNDS {
        if !may() {
            break;
        }
        let Some(bent) = bent(values)? else { return Ok(None) };
        let before = best;
        for _ in 0..4 {
            let Some(next) = moved(parameters, values, &bent, damping) else { break };
            let found = worth(&next)?;
            if found < best {
                (best, *values) = (found, next);
                damping = (damping / 4.0).max(DAMPING[1]);
                break;
            }
            damping *= 4.0;
        }
        if before - best < MIN_GAIN * before {
            break;
        }
    }
    Ok(Some(best))
}
