//! Sums of errors over rollouts, for a [`PassiveReport`].

use super::gaps::{Gaps, quantities};
use crate::prelude::*;

/// A rollout with an entry of q or qd beyond this (m, rad, m/s or rad/s) is frozen.
const GONE: f64 = 1e5;
/// A rollout faster than this multiple of the truth's largest speed has diverged.
const FAST: f64 = 3.0;
/// The truth's speed (rad/s, m/s) counts as at least this, even at rest.
const SLOW: f64 = 0.1;

/// Errors of one solver against the truth. Figures are in the order of [`super::quantities`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PassiveReport {
    /// Mean absolute difference between solver and truth (m or rad), over all steps and trajectories.
    pub error: Vec<f64>,
    /// Standard error of [`PassiveReport::error`], over trajectories.
    pub standard_error: Vec<f64>,
    /// The same as [`PassiveReport::error`] for a predictor that repeats the start state.
    pub hold: Vec<f64>,
    /// Mean absolute difference between solver and truth over trajectories and quantities, by step; entry 0 is step 1.
    pub curve: Vec<f64>,
    /// Number of rollouts that failed, had an entry of q or qd beyond 1e5, or became too fast. Too fast is three times
    /// the truth's largest joint, angular or linear speed, at least 0.3 (rad/s or m/s).
    pub diverged: usize,
    /// First step at which a rollout failed or had an entry of q or qd beyond 1e5.
    pub first_divergence: Option<usize>,
    /// Number of rollouts that the solver could not continue. Their states stay constant and are still compared with
    /// the truth.
    #[serde(default)]
    pub failed: usize,
}

/// Sums of the errors of `n` rollouts over the steps so far.
pub(super) struct Tally {
    gaps: Gaps,
    n: usize,
    width: usize,
    /// Sums over steps of |difference| from the truth, `[trajectory][quantity]`: of the solver, and of the baseline
    /// `hold`.
    sums: [Vec<f64>; 2],
    /// Present |difference| between solver and truth, `[trajectory][quantity]`; constant once the rollout is frozen.
    last: Vec<f64>,
    /// Largest speeds so far (joint, angular, linear): `fastest` of the truth over all rollouts, `speeds` of the solver
    /// by rollout.
    fastest: [f64; 3],
    speeds: Vec<[f64; 3]>,
    /// By rollout: `gone` is the step that froze the rollout, `failed` the step of the solver's first failure.
    gone: Vec<Option<usize>>,
    failed: Vec<Option<usize>>,
    curve: Vec<f64>,
    gap: Vec<f64>,
}

impl Tally {
    pub fn new(system: &Arc<System>, n: usize) -> Self {
        let width = quantities(system).len();
        let zeros = || vec![0.0; n * width];
        Self {
            gaps: Gaps::new(system),
            n,
            width,
            sums: [zeros(), zeros()],
            last: zeros(),
            fastest: [0.0; 3],
            speeds: vec![[0.0; 3]; n],
            gone: vec![None; n],
            failed: vec![None; n],
            curve: Vec::new(),
            gap: vec![0.0; width],
        }
    }

    /// Steps all rollouts and adds their errors. `real` are the true states after the step, `first` the states at the
    /// start.
    pub fn step(
        &mut self,
        solver: &mut dyn Solver,
        (learned, torques): (&mut Batch, &[f64]),
        [real, first]: [&[f64]; 2],
    ) -> Result<(), StepError> {
        let (step, d) = (self.curve.len() + 1, learned.system.robot.state_dim());
        if let Err(error) = solver.step(learned, torques) {
            error.faults()?.iter().for_each(|fault| self.failed[fault.env] = self.failed[fault.env].or(Some(step)));
        }
        for env in 0..self.n {
            let row = env * d..(env + 1) * d;
            if !self.add(env, step, [&real[row.clone()], learned.state(env), &first[row.clone()]]) {
                // Resets a frozen rollout to its start, so that its numbers do not overflow.
                learned.reset(env, &first[row]);
                solver.reset(env);
            }
        }
        let total: f64 = self.last.chunks(self.width).map(|row| row.iter().sum::<f64>()).sum();
        self.curve.push(total / (self.n * self.width) as f64);
        Ok(())
    }

    /// Adds the errors of one rollout at one step, from the states of truth, solver and start. Returns whether the
    /// rollout goes on.
    fn add(&mut self, env: usize, step: usize, [real, learned, first]: [&[f64]; 3]) -> bool {
        let row = env * self.width..(env + 1) * self.width;
        if self.gone[env].is_none() {
            self.gaps.between(real, learned, &mut self.last[row.clone()]);
            let now = self.gaps.speeds(learned);
            self.speeds[env].iter_mut().zip(now).for_each(|(s, v)| *s = s.max(v));
        }
        let now = self.gaps.speeds(real);
        self.fastest.iter_mut().zip(now).for_each(|(s, v)| *s = s.max(v));
        let [sums, of_hold] = &mut self.sums;
        add(&mut sums[row.clone()], &self.last[row.clone()]);
        self.gaps.between(real, first, &mut self.gap);
        add(&mut of_hold[row], &self.gap);
        if self.gone[env].is_none() && learned.iter().any(|x| x.abs() > GONE) {
            self.gone[env] = Some(step);
        }
        self.gone[env].is_none()
    }

    /// The report after `steps` steps.
    pub fn report(self, steps: usize) -> PassiveReport {
        let of = |sums: &[f64], k: usize| sums.iter().skip(k).step_by(self.width).copied().collect_vec();
        let mean = |sums: &[f64], k: usize| of(sums, k).iter().sum::<f64>() / (self.n * steps) as f64;
        let means = |sums: &[f64]| (0..self.width).map(|k| mean(sums, k)).collect_vec();
        let spread = |k: usize| {
            let m = mean(&self.sums[0], k);
            let squares = of(&self.sums[0], k).into_iter().map(|s| (s / steps as f64 - m).powi(2));
            (squares.sum::<f64>() / (self.n.max(2) - 1) as f64 / self.n as f64).sqrt()
        };
        let fast = |env: usize| self.speeds[env].iter().zip(self.fastest).any(|(v, most)| *v > FAST * most.max(SLOW));
        let away = |env: &usize| self.gone[*env].is_some() || self.failed[*env].is_some() || fast(*env);
        PassiveReport {
            error: means(&self.sums[0]),
            standard_error: (0..self.width).map(spread).collect(),
            hold: means(&self.sums[1]),
            diverged: (0..self.n).filter(away).count(),
            first_divergence: self.gone.iter().chain(&self.failed).flatten().min().copied(),
            failed: self.failed.iter().flatten().count(),
            curve: self.curve,
        }
    }
}
