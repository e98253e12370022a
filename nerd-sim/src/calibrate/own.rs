//! Fits parameters of individual trajectories, such as zeros set by hand, together with shared parameters, in one
//! descent. A trajectory's parameters get gradients from its trials only.

use std::{cell::Cell, collections::BTreeMap};

use nalgebra::{DMatrix, DVector};

use super::bent::{Bent, descend};
use super::fit::{Fit, FitConfig, MIN_BOUND_DISTANCE, ROUND_COST, STAGES, objective, thinned};
use super::parameter::{CalibrateError, Parameter, pull};
use super::subject::Subject;
use super::trial::{Distance, Trial, mean};

/// Result of a fit of shared and individual parameters.
pub struct OwnFit {
    /// Fit of the shared parameters.
    pub shared: Fit,
    /// Values of each trajectory's individual parameters, by trajectory.
    pub own: BTreeMap<u64, Vec<f64>>,
}

impl Subject {
    /// Fits shared parameters and each trajectory's individual parameters to trials of several trajectories. `progress`
    /// receives evaluations done and the best objective so far.
    ///
    /// # Errors
    /// Under the conditions of [`Subject::fit`], and for a solver without gradients.
    pub fn fit_own(
        &self,
        [shared, own]: [&[Parameter]; 2],
        trials: &[Trial],
        config: FitConfig,
        progress: &mut dyn FnMut(usize, f64),
    ) -> Result<OwnFit, CalibrateError> {
        let trials = thinned(trials, config.trials);
        if trials.is_empty() {
            return Err(CalibrateError::Empty);
        }
        let mut ids: Vec<u64> = trials.iter().map(|t| t.id).collect();
        ids.dedup();
        let split = Split { shared: shared.len(), own: own.len() };
        let pair = [shared, own].concat();
        let all: Vec<Parameter> = shared.iter().chain(ids.iter().flat_map(|_| own)).cloned().collect();
        let mut values: Vec<f64> =
            all.iter().map(|p| p.at(p.place(p.nominal).clamp(MIN_BOUND_DISTANCE, 1.0 - MIN_BOUND_DISTANCE))).collect();
        let spent = Cell::new(0.0);
        for [frames, share] in STAGES {
            let seen = thinned(&trials, (share * trials.len() as f64).ceil() as usize);
            let of = |id: &u64| seen.iter().filter(|t| t.id == *id).map(|t| t.begun(frames)).collect::<Vec<_>>();
            let groups: Vec<Vec<Trial>> = ids.iter().map(of).collect();
            let unit = mean(&self.distances(&groups.concat())?);
            let worth = |values: &[f64]| {
                spent.set(spent.get() + frames * share);
                self.worth_of(&pair, split, values, &groups, &unit, seen.len())
            };
            let pass = ROUND_COST * frames * share;
            let bent = |values: &[f64]| {
                spent.set(spent.get() + pass);
                self.bent_of(&pair, split, values, &groups, &unit)
            };
            let may = || spent.get() + pass < config.evaluations as f64;
            let Some(best) = descend(&all, &mut values, may, worth, bent)? else {
                let text = "parameters that each trajectory has of its own need gradients, which this solver has not; take articulated";
                return Err(CalibrateError::Parameter(text.into()));
            };
            progress(spent.get() as usize, best);
        }
        let of = |id: &u64| trials.iter().filter(|t| t.id == *id).cloned().collect::<Vec<_>>();
        let apart = ids.iter().enumerate().map(|(k, id)| self.with(&pair, &split.part(&values, k))?.distances(&of(id)));
        let (before, mut after) =
            (mean(&self.distances(&trials)?), mean(&apart.collect::<Result<Vec<_>, _>>()?.concat()));
        // Keep the fitted values only if their objective over all trials is no larger than with nominal parameters.
        let kept = objective(&after, &before);
        if !kept.is_finite() || kept > objective(&before, &before) {
            values = all.iter().map(|p| p.nominal).collect();
            after = before;
        }
        let own = ids.iter().enumerate().map(|(k, id)| (*id, split.part(&values, k).split_off(split.shared))).collect();
        values.truncate(split.shared);
        let objective = objective(&after, &before);
        let evaluations = spent.get();
        Ok(OwnFit { shared: Fit { values, objective, before, after, evaluations, gradients: true }, own })
    }

    /// Objective at `values` of all parameters. `groups`: trials of each trajectory; `seen`: total number of trials.
    fn worth_of(
        &self,
        pair: &[Parameter],
        split: Split,
        values: &[f64],
        groups: &[Vec<Trial>],
        unit: &Distance,
        seen: usize,
    ) -> Result<f64, CalibrateError> {
        let apart = groups.iter().enumerate().filter(|(_, trials)| !trials.is_empty());
        let apart = apart.map(|(k, trials)| self.with(pair, &split.part(values, k))?.distances(trials));
        let costs =
            groups.iter().enumerate().map(|(k, trials)| trials.len() as f64 * pull(pair, &split.part(values, k)));
        let worth =
            objective(&mean(&apart.collect::<Result<Vec<_>, _>>()?.concat()), unit) + costs.sum::<f64>() / seen as f64;
        Ok(if worth.is_finite() { worth } else { f64::MAX })
    }

    /// Gradient and Hessian of all groups by all parameters; `None` if the solver has no gradients.
    fn bent_of(
        &self,
        pair: &[Parameter],
        split: Split,
        values: &[f64],
        groups: &[Vec<Trial>],
        unit: &Distance,
    ) -> Result<Option<Bent>, CalibrateError> {
        let n = values.len();
        let mut sum = Bent { gradient: DVector::zeros(n), curvature: DMatrix::zeros(n, n) };
        for (k, trials) in groups.iter().enumerate() {
            let Some(found) = self.bent(pair, &split.part(values, k), trials, unit)? else { return Ok(None) };
            for (a, i) in split.places(k).enumerate() {
                sum.gradient[i] += found.gradient[a];
                split.places(k).enumerate().for_each(|(b, j)| sum.curvature[(i, j)] += found.curvature[(a, b)]);
            }
        }
        Ok(Some(sum))
    }
}

/// Number of shared parameters, and number of individual parameters per trajectory. In a list of all parameters the
/// shared ones come first, then those of one trajectory after the other.
#[derive(Clone, Copy)]
struct Split {
    shared: usize,
    own: usize,
}

impl Split {
    /// Indices of the k-th trajectory's parameters (shared, then individual) among all.
    fn places(self, k: usize) -> impl Iterator<Item = usize> {
        (0..self.shared).chain(self.shared + k * self.own..self.shared + (k + 1) * self.own)
    }

    /// Values of the k-th trajectory's parameters (shared, then individual).
    fn part(self, values: &[f64], k: usize) -> Vec<f64> {
        self.places(k).map(|i| values[i]).collect()
    }
}
