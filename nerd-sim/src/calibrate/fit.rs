//! Fits parameters: descent where the solver has gradients, else CMA-ES within the bounds (Hansen, "The CMA Evolution
//! Strategy: A Tutorial", arXiv 1604.00772; crate fcmaes-core).

use std::cell::Cell;

use fcmaes_core::{Cmaes, CmaesParams, Fitness};
use serde::{Deserialize, Serialize};

use super::bent::descend;
use super::parameter::{CalibrateError, Parameter, pull};
use super::subject::Subject;
use super::trial::{Distance, Trial, mean};

/// Settings of a fit. Search (CMA-ES) and descent both go from coarse to fine. The two coarse searches in the first
/// half of the budget use a quarter of the trials. All stages of a descent but the last use a quarter, too.
#[derive(Clone, Copy, Debug)]
pub struct FitConfig {
    /// Budget in evaluations of the objective. In a search each evaluation counts 1. In a descent it counts its share of
    /// the trials times its share of the frames, and a round's gradients count as ten evaluations.
    pub evaluations: usize,
    /// Maximum number of trials, evenly chosen.
    pub trials: usize,
    /// Seed of the search; a descent is deterministic.
    pub seed: u64,
    /// Whether to use gradients where the solver has them; otherwise CMA-ES is used.
    pub gradients: bool,
}

impl Default for FitConfig {
    fn default() -> Self {
        Self { evaluations: 1000, trials: 500, seed: 0, gradients: true }
    }
}

/// Shares of frames and of trials in each stage of a descent.
pub(super) const STAGES: [[f64; 2]; 4] = [[0.125, 0.25], [0.5, 0.25], [1.0, 0.25], [1.0, 1.0]];
/// Least distance of a descent's start from the bounds, in scaled parameters: at zero, dry friction has no gradient.
pub(super) const MIN_BOUND_DISTANCE: f64 = 0.01;
/// Cost of a round's gradients, in evaluations of the objective over the same trials.
pub(super) const ROUND_COST: f64 = 10.0;
/// Initial step sizes of the coarse and the fine search, in scaled parameters.
const STEPS: [f64; 2] = [0.15, 0.04];

/// Result of a fit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Fit {
    /// Values of the parameters, in order of the parameters.
    pub values: Vec<f64>,
    /// Objective at `values`: mean of the distances, each relative to its nominal value, plus the cost of the
    /// parameters.
    pub objective: f64,
    /// Mean distances with nominal parameters.
    pub before: Distance,
    /// Mean distances with `values`.
    pub after: Distance,
    /// Evaluations of the objective, weighted by their share of trials and frames; a round's gradients count ten times
    /// as much.
    pub evaluations: f64,
    /// Whether gradients were used.
    pub gradients: bool,
}

/// Mean of the distances, each relative to its value in `unit`; parts without a unit, such as joints of a single body,
/// are left out.
pub(super) fn objective(apart: &Distance, unit: &Distance) -> f64 {
    let parts = apart.parts().into_iter().zip(unit.parts());
    let (sum, n) = parts.filter(|p| p.1 > 0.0).fold((0.0, 0.0), |(sum, n), p| (sum + p.0 / p.1, n + 1.0));
    if n > 0.0 { sum / n } else { 0.0 }
}

/// At most `most` of the trials, evenly chosen.
pub fn thinned(trials: &[Trial], most: usize) -> Vec<Trial> {
    trials.iter().step_by(trials.len().div_ceil(most.max(1)).max(1)).cloned().collect()
}

struct Search<'a> {
    subject: &'a Subject,
    parameters: &'a [Parameter],
    trials: &'a [Trial],
    unit: Distance,
    /// Cost of an evaluation, relative to one over all trials and frames; `spent`: total cost so far.
    share: f64,
    spent: &'a Cell<f64>,
}

impl<'a> Search<'a> {
    fn new(
        subject: &'a Subject,
        parameters: &'a [Parameter],
        trials: &'a [Trial],
        share: f64,
        spent: &'a Cell<f64>,
    ) -> Result<Self, CalibrateError> {
        spent.set(spent.get() + share);
        Ok(Self { subject, parameters, trials, unit: mean(&subject.distances(trials)?), share, spent })
    }

    /// The objective at `values`, and the mean distances.
    fn worth(&self, values: &[f64]) -> Result<(f64, Distance), CalibrateError> {
        self.spent.set(self.spent.get() + self.share);
        let apart = mean(&self.subject.with(self.parameters, values)?.distances(self.trials)?);
        let worth = objective(&apart, &self.unit) + pull(self.parameters, values);
        Ok((if worth.is_finite() { worth } else { f64::MAX }, apart))
    }

    /// Runs CMA-ES from `from`; returns the best objective and its values.
    fn run(
        &self,
        from: &[f64],
        step: f64,
        budget: usize,
        seed: u64,
        progress: &mut dyn FnMut(usize, f64),
    ) -> Result<(f64, Vec<f64>), CalibrateError> {
        let n = self.parameters.len();
        let mut best = (self.worth(from)?.0, from.to_vec());
        if n == 0 {
            return Ok(best);
        }
        let start: Vec<f64> = self.parameters.iter().zip(from).map(|(p, v)| p.place(*v)).collect();
        let popsize = 4 + (3.0 * (n as f64).ln()) as i32;
        let params =
            CmaesParams { popsize, mu: popsize / 2, max_evaluations: budget as u64, seed, ..Default::default() };
        let mut search =
            Cmaes::new(Fitness::bounded(n, 1, &vec![0.0; n], &vec![1.0; n]), &start, &vec![step; n], &params);
        let mut done = 1;
        while done < budget && search.stop() == 0 {
            let mut worths = Vec::new();
            for x in search.ask() {
                let values: Vec<f64> = self.parameters.iter().zip(&x).map(|(p, x)| p.at(*x)).collect();
                let (worth, _) = self.worth(&values)?;
                if worth < best.0 {
                    best = (worth, values);
                }
                worths.push(worth);
                done += 1;
            }
            search.tell(&worths);
            progress(done, best.0);
        }
        Ok(best)
    }
}

/// Runs CMA-ES from coarse to fine; returns the best values.
fn searched(
    all: &Search,
    few: &[Trial],
    config: FitConfig,
    progress: &mut dyn FnMut(usize, f64),
) -> Result<Vec<f64>, CalibrateError> {
    let quarter = config.evaluations.div_ceil(4);
    let mut done = 0;
    let nominal: Vec<f64> = all.parameters.iter().map(|p| p.nominal).collect();
    // Two coarse searches: contact has separate minima, such as high friction that creeps and low friction that sticks.
    let coarse = Search::new(all.subject, all.parameters, few, few.len() as f64 / all.trials.len() as f64, all.spent)?;
    let mut best = (f64::INFINITY, nominal.clone());
    for run in 0..2 {
        let seed = config.seed.wrapping_mul(2).wrapping_add(run);
        let found = coarse.run(&nominal, STEPS[0], quarter, seed, &mut |own, worth| progress(done + own, worth))?;
        done += quarter;
        if found.0 < best.0 {
            best = found;
        }
    }
    let rest = config.evaluations.saturating_sub(done);
    Ok(all.run(&best.1, STEPS[1], rest, config.seed, &mut |own, worth| progress(done + own, worth))?.1)
}

impl Subject {
    /// Fits parameters to trials; `progress` receives evaluations done and the best objective so far.
    pub fn fit(
        &self,
        parameters: &[Parameter],
        trials: &[Trial],
        config: FitConfig,
        progress: &mut dyn FnMut(usize, f64),
    ) -> Result<Fit, CalibrateError> {
        if trials.is_empty() {
            return Err(CalibrateError::Empty);
        }
        let fine = thinned(trials, config.trials);
        let few = thinned(&fine, fine.len().div_ceil(4));
        let spent = Cell::new(0.0);
        let all = Search::new(self, parameters, &fine, 1.0, &spent)?;
        let nominal: Vec<f64> = parameters.iter().map(|p| p.nominal).collect();
        let descended =
            if config.gradients { self.descended(&all, &few, config.evaluations as f64, progress)? } else { None };
        let gradients = descended.is_some();
        let ends = match descended {
            Some(ends) => ends,
            None => vec![searched(&all, &few, config, progress)?],
        };
        // A gain on a few trials may be a loss on all trials.
        let mut best = all.worth(&nominal)?;
        let mut values = nominal;
        for end in ends {
            let own = all.worth(&end)?;
            if own.0 < best.0 {
                (best, values) = (own, end);
            }
        }
        let (objective, after) = best;
        Ok(Fit { values, objective, before: all.unit, after, evaluations: spent.get(), gradients })
    }

    /// Descends from nominal parameters within `budget`; returns the values after each stage, or `None` without
    /// gradients.
    fn descended(
        &self,
        all: &Search,
        few: &[Trial],
        budget: f64,
        progress: &mut dyn FnMut(usize, f64),
    ) -> Result<Option<Vec<Vec<f64>>>, CalibrateError> {
        let parameters = all.parameters;
        let spent = all.spent;
        if parameters.is_empty() {
            return Ok(None);
        }
        let mut values: Vec<f64> = parameters
            .iter()
            .map(|p| p.at(p.place(p.nominal).clamp(MIN_BOUND_DISTANCE, 1.0 - MIN_BOUND_DISTANCE)))
            .collect();
        let mut ends = Vec::new();
        for [frames, share] in STAGES {
            let trials: Vec<Trial> =
                if share < 1.0 { few } else { all.trials }.iter().map(|trial| trial.begun(frames)).collect();
            let search = Search::new(self, parameters, &trials, frames * share, spent)?;
            let pass = ROUND_COST * search.share;
            let bent = |v: &[f64]| {
                spent.set(spent.get() + pass);
                self.bent(parameters, v, &trials, &search.unit)
            };
            let may = || spent.get() + pass < budget;
            let Some(best) = descend(parameters, &mut values, may, |v| Ok(search.worth(v)?.0), bent)? else {
                return Ok(None);
            };
            progress(spent.get() as usize, best);
            ends.push(values.clone());
        }
        Ok(Some(ends))
    }

    /// Profile of the objective along each parameter with the others as fitted: pairs of value and objective, in
    /// increasing order of the value. The objective excludes the cost of the parameters.
    pub fn profiles(
        &self,
        parameters: &[Parameter],
        fit: &Fit,
        trials: &[Trial],
        places: usize,
    ) -> Result<Vec<Vec<[f64; 2]>>, CalibrateError> {
        let along = |k: usize| -> Result<Vec<[f64; 2]>, CalibrateError> {
            let own = parameters[k].place(fit.values[k]);
            let mut at: Vec<f64> = (0..places).map(|i| i as f64 / (places - 1).max(1) as f64).chain([own]).collect();
            at.sort_by(f64::total_cmp);
            let worth = |x: &f64| {
                let mut values = fit.values.clone();
                values[k] = parameters[k].at(*x);
                let apart = mean(&self.with(parameters, &values)?.distances(trials)?);
                Ok([values[k], objective(&apart, &fit.before)])
            };
            at.iter().map(worth).collect()
        };
        (0..parameters.len()).map(along).collect()
    }
}
