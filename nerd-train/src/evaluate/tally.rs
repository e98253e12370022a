//! Sums over a rollout, for its report.

use super::gaps::{Gaps, quantities};
use crate::prelude::*;

/// A coordinate beyond this (rad or m) is of a rollout that is gone.
const GONE: f64 = 1e5;
/// Multiple of the truth's largest speed beyond which a rollout has diverged.
const FAST: f64 = 3.0;
/// What is slower (rad/s, m/s) has not left, though the truth rests.
const SLOW: f64 = 0.1;

/// Errors of one solver against the truth; figures in the order of [`super::quantities`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PassiveReport {
    /// Mean |difference| over all steps and trajectories.
    pub error: Vec<f64>,
    /// Standard error of that mean over trajectories.
    pub standard_error: Vec<f64>,
    /// The same mean for the predictor that repeats the start.
    pub hold: Vec<f64>,
    /// Mean |difference| averaged over the quantities by step, from step 1.
    pub curve: Vec<f64>,
    /// Rollouts whose joints, turning or travel passed three times the truth's largest speed (of one that rests 0.3), or that left 1e5.
    pub diverged: usize,
    /// First step at which a rollout diverged.
    pub first_divergence: Option<usize>,
    /// Of those, rollouts that the solver could not continue. They stay where they were, and
    /// are compared with the truth there.
    #[serde(default)]
    pub failed: usize,
}

/// What has been seen so far of `n` rollouts.
pub(super) struct Tally {
    gaps: Gaps,
    n: usize,
    width: usize,
    /// Sums of |difference| over steps, by trajectory and quantity: of the solver, of hold.
    sums: [Vec<f64>; 2],
    /// |difference| of a rollout as it is, or, if it is gone, as it was when it went: it stays in the mean at that.
    last: Vec<f64>,
    /// Largest speeds: of the truth in any rollout, of the solver by rollout.
    fastest: [f64; 3],
    speeds: Vec<[f64; 3]>,
    /// Steps at which rollouts went, and at which the solver could not go on with them.
    gone: Vec<Option<usize>>,
    failed: Vec<Option<usize>>,
    curve: Vec<f64>,
    gap: Vec<f64>,
}

impl Tally {
    pub(super) fn new(system: &Arc<System>, n: usize) -> Self {
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

    /// Steps all rollouts and adds the step, given the true states after it and those at the start.
    pub(super) fn step(
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
                // Out of the way of overflow.
                learned.reset(env, &first[row]);
                solver.reset(env);
            }
        }
        let total: f64 = self.last.chunks(self.width).map(|row| row.iter().sum::<f64>()).sum();
        self.curve.push(total / (self.n * self.width) as f64);
        Ok(())
    }

    /// Adds a step of a rollout, from the states of the truth, of the solver and of the start; whether the rollout goes on.
    fn add(&mut self, env: usize, step: usize, [real, learned, first]: [&[f64]; 3]) -> bool {
        let row = env * self.width..(env + 1) * self.width;
        if self.gone[env].is_none() {
            self.gaps.between(real, learned, &mut self.last[row.clone()]);
            let now = self.gaps.speeds(learned);
            self.speeds[env].iter_mut().zip(now).for_each(|(s, v)| *s = s.max(v));
        }
        let now = self.gaps.speeds(real);
        self.fastest.iter_mut().zip(now).for_each(|(s, v)| *s = s.max(v));
        let add = |sums: &mut Vec<f64>, gap: &[f64]| sums[row.clone()].iter_mut().zip(gap).for_each(|(s, g)| *s += g);
        add(&mut self.sums[0], &self.last[row.clone()]);
        self.gaps.between(real, first, &mut self.gap);
        add(&mut self.sums[1], &self.gap);
        if self.gone[env].is_none() && learned.iter().any(|x| x.abs() > GONE) {
            self.gone[env] = Some(step);
        }
        self.gone[env].is_none()
    }

    /// The report after `steps` steps.
    pub(super) fn report(self, steps: usize) -> PassiveReport {
        let of = |sums: &[f64], k: usize| sums.iter().skip(k).step_by(self.width).copied().collect::<Vec<f64>>();
        let mean = |sums: &[f64], k: usize| of(sums, k).iter().sum::<f64>() / (self.n * steps) as f64;
        let means = |sums: &[f64]| (0..self.width).map(|k| mean(sums, k)).collect::<Vec<_>>();
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
