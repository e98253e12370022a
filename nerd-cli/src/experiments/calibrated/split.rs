//! Splits of a log by trajectory, and errors on the test part.

use nerd_sim::calibrate::{Distance, Fit, Subject, Trial, distance, mean};
use nerd_sim::log::Log;
use rand::{RngExt, seq::SliceRandom};

use crate::prelude::*;

/// Trials for fitting and for testing; no trajectory is in both.
pub(super) struct Parts {
    pub train: Vec<Trial>,
    pub judged: Vec<Trial>,
    pub whole: Vec<Trial>,
    ids: Vec<u64>,
}

/// Mean distances, and their 95 % intervals from resampling trajectories.
#[derive(Clone, Serialize, Deserialize)]
pub struct Scored {
    pub mean: Distance,
    pub low: Distance,
    pub high: Distance,
}

#[derive(Serialize, Deserialize)]
pub struct Split {
    pub judged: Vec<u64>,
    pub fit: FitOf,
    /// Errors of the robot as described, before calibration, on the test part.
    pub before: Scored,
    pub after: Scored,
    pub whole_before: Scored,
    pub whole_after: Scored,
}

#[derive(Serialize, Deserialize)]
pub struct FitOf {
    pub values: Vec<f64>,
    pub objective: f64,
    pub evaluations: f64,
    /// Wall time of the fit (s).
    pub seconds: f64,
}

/// Share of the trajectories used for fitting (%); the paper fits to 400 of 570.
pub(super) const FITTED: usize = 68;
/// Share of the other trajectories used for testing; the paper tests on 85 of 170.
const JUDGED: f64 = 0.5;
/// Number of bootstrap samples of the trajectories.
const SETS: usize = 1000;

impl Parts {
    /// Splits a log's trajectories at random; refuses a split with an empty part.
    pub fn new(log: &Log, trials: &[Trial], seed: u64) -> Result<Self> {
        let mut ids = ids(log);
        ids.shuffle(&mut stream(seed, 0));
        // Keeps at least one trajectory for testing.
        let first = (ids.len() * FITTED).div_ceil(100).min(ids.len().saturating_sub(1));
        let last = (first + ((ids.len() - first) as f64 * JUDGED).ceil() as usize).min(ids.len());
        let of = |ids: &[u64], trials: &[Trial]| trials.iter().filter(|t| ids.contains(&t.id)).cloned().collect_vec();
        let mut judged = ids[first..last].to_vec();
        judged.sort_unstable();
        let parts = Self {
            train: of(&ids[..first], trials),
            judged: of(&judged, trials),
            whole: of(&judged, &log.trials(0, 1)),
            ids: judged,
        };
        if parts.train.is_empty() || parts.judged.is_empty() {
            let longest = log.trajectories.iter().map(|t| t.states.len()).max().unwrap_or_default();
            bail!(
                "{} trajectories, the longest of {longest} frames: {} rollouts to fit to and {} to judge on; two trajectories are needed, longer than --frames",
                ids.len(),
                parts.train.len(),
                parts.judged.len()
            );
        }
        Ok(parts)
    }

    pub fn split(&self, [before, after]: [&Subject; 2], (fit, seconds): (&Fit, f64), seed: u64) -> Result<Split> {
        let scored = |trials: &[Trial], distances: Vec<Distance>| Scored::new(trials, &distances, seed);
        Ok(Split {
            judged: self.ids.clone(),
            fit: FitOf { values: fit.values.clone(), objective: fit.objective, evaluations: fit.evaluations, seconds },
            before: scored(&self.judged, before.distances(&self.judged)?),
            after: scored(&self.judged, after.distances(&self.judged)?),
            whole_before: scored(&self.whole, before.distances(&self.whole)?),
            whole_after: scored(&self.whole, after.distances(&self.whole)?),
        })
    }

    pub fn still(&self, log: &Log, seed: u64) -> Scored {
        Scored::new(&self.judged, &still(log, &self.judged), seed)
    }
}

/// Lists the ids of a log's trajectories; an id that several pieces share is listed once.
pub(super) fn ids(log: &Log) -> Vec<u64> {
    log.trajectories.iter().map(|t| t.id).dedup().collect()
}

/// Computes the distances of a predictor without motion, which repeats each trial's start.
pub(super) fn still(log: &Log, trials: &[Trial]) -> Vec<Distance> {
    let none = |t: &Trial| distance(&log.system, &vec![t.measured[0].clone(); t.measured.len()], &t.measured);
    trials.iter().map(none).collect()
}

/// Values of `of` over `sets` resamples of `all` with replacement.
pub(super) fn resampled<T: Clone, V>(all: &[T], sets: usize, seed: u64, of: impl Fn(&[T]) -> V) -> Vec<V> {
    let mut rng = stream(seed, 1);
    let mut drawn = |_| all[rng.random_range(0..all.len())].clone();
    (0..sets).map(|_| of(&(0..all.len()).map(&mut drawn).collect_vec())).collect()
}

impl Scored {
    /// Averages distances, with 95 % intervals from resampling whole trajectories with replacement.
    pub(super) fn new(trials: &[Trial], distances: &[Distance], seed: u64) -> Self {
        let mut by_id: BTreeMap<u64, Vec<Distance>> = BTreeMap::new();
        trials.iter().zip(distances).for_each(|(t, g)| by_id.entry(t.id).or_default().push(*g));
        let groups = by_id.into_values().collect_vec();
        let sets = resampled(&groups, SETS, seed, |groups| mean(&groups.concat()));
        let end = |share: f64| {
            let of = |field: fn(&Distance) -> f64| percentile(sets.iter().map(field).collect(), share);
            let position = of(|g| g.position);
            let rotation = of(|g| g.rotation);
            Distance { position, rotation, joints: of(|g| g.joints), other_side: of(|g| g.other_side) }
        };
        Self { mean: mean(distances), low: end(0.025), high: end(0.975) }
    }
}
