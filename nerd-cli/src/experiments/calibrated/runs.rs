//! Fits per-trajectory parameters, such as sensor zeros set by hand before a run, to each trajectory's first frames.
//! The shared parameters are fitted to the other folds. Every trajectory is tested once, on its later frames.

use nerd_sim::calibrate::{FitConfig, Parameter, Subject, Trial};
use nerd_sim::log::Log;

use super::split::{ids, resampled, still};
use super::{Calibration, stem, tables::listed};
use crate::prelude::*;

/// Candidate penalties on per-trajectory values that differ from the shared value, chosen within the training folds. A
/// penalty is the joint error (rad or m) that a difference of the full range between the bounds costs.
const WEIGHTS: [f64; 6] = [0.0, 0.3, 1.0, 3.0, 10.0, 30.0];
/// Number of bootstrap samples of the trajectories.
const SETS: usize = 2000;
/// Index of the method below which other errors are measured: `calibrated`. With penalised parameters, it is the next
/// method instead.
const BASIS: usize = 2;

#[derive(Serialize, Deserialize)]
pub struct Judged {
    /// Name of the log.
    pub log: String,
    /// Id of the trajectory in the log.
    pub id: u64,
    /// Number of test rollouts, by length.
    pub rollouts: Vec<usize>,
    /// Mean joint errors `[method][length]` (rad or m) over all predicted frames.
    pub errors: Vec<Vec<f64>>,
}

#[derive(Serialize, Deserialize)]
pub struct Runs {
    #[serde(flatten)]
    pub settings: Calibration,
    pub notes: Vec<String>,
    pub methods: Vec<String>,
    pub lengths: Vec<usize>,
    /// Penalty on leaving the shared values for each test fold, chosen on the other folds.
    pub weights: Vec<f64>,
    pub judged: Vec<Judged>,
}

/// Parameters learned from a log without some of its trajectories.
struct Learned<'a> {
    log: &'a Log,
    /// Robot with the shared parameters, which were fitted together with each trajectory's own parameters.
    shared: Subject,
    /// Per-trajectory parameters without penalty.
    own: Vec<Parameter>,
    /// Per-trajectory parameters that are penalised for leaving the shared value.
    held: Vec<Parameter>,
}

impl Calibration {
    fn config(&self, share: usize) -> FitConfig {
        FitConfig { evaluations: self.evaluations / share, trials: self.rollouts, seed: self.seed, gradients: true }
    }

    /// Cuts a log into rollouts for fitting, half as long as those for testing.
    fn pieces(&self, log: &Log, every: usize) -> Vec<Trial> {
        log.trials((self.frames / 2).max(1) + 1, every.max(1))
    }

    /// Rollouts for fitting, from all trajectories but `out`.
    fn others(&self, log: &Log, out: &[u64]) -> Vec<Trial> {
        self.pieces(log, self.every).into_iter().filter(|t| !out.contains(&t.id)).collect()
    }

    fn learned<'a>(&self, log: &'a Log, out: &[u64]) -> Result<Learned<'a>> {
        let (described, parameters) = self.subject(log, "articulated")?;
        let own: Vec<_> = self.per_trajectory.iter().map(|name| Parameter::named(&log.system, name)).try_collect()?;
        let shared =
            described.fit_own([&parameters, &own], &self.others(log, out), self.config(1), &mut |_, _| ())?.shared;
        let of = |name: &String| match parameters.iter().zip(&shared.values).find(|(p, _)| p.name == *name) {
            Some((p, value)) => Ok(p.near(*value, 0.0)),
            None => Parameter::named(&log.system, name),
        };
        let held = self.regularized.iter().map(of).try_collect()?;
        Ok(Learned { log, shared: described.with(&parameters, &shared.values)?, own, held })
    }

    /// Fits the per-trajectory parameters of trajectory `id` to its first frames, on the robot with the shared
    /// parameters. With `weight`, the penalised parameters are fitted too.
    fn told(&self, learned: &Learned, id: u64, weight: Option<f64>) -> Result<Subject> {
        let mut seen = self.pieces(learned.log, self.every / 2);
        seen.retain(|t| t.id == id && t.first + t.measured.len() <= self.context_frames + 1);
        if seen.is_empty() {
            bail!(
                "--context-frames {}: no rollout of {} frames is in what is before; take more, or fewer --frames",
                self.context_frames,
                self.frames / 2
            );
        }
        let mut parameters = learned.own.clone();
        if let Some(weight) = weight {
            // Divides the penalty by the initial error, as the fit divides the objective by its initial value.
            let unit = nerd_sim::calibrate::mean(&learned.shared.distances(&seen)?).joints;
            parameters.extend(learned.held.iter().map(|p| p.near(p.nominal, weight / unit.max(f64::MIN_POSITIVE))));
        }
        fitted(&learned.shared, &parameters, &seen, self.config(4))
    }

    /// Counts the rollouts of each length after a trajectory's first frames, and averages their joint errors (rad or
    /// m). `subject: None` predicts no motion.
    fn errors(
        &self,
        log: &Log,
        id: u64,
        subject: Option<&Subject>,
        lengths: &[usize],
    ) -> Result<(Vec<usize>, Vec<f64>)> {
        let of = |frames: &usize| -> Result<(usize, f64)> {
            let mut trials = log.trials(frames + 1, self.every);
            trials.retain(|t| t.id == id && t.first >= self.context_frames);
            let found = subject.map_or_else(|| Ok(still(log, &trials)), |subject| subject.distances(&trials))?;
            // Corrects the mean distance, which also counts the start frame, where the error is 0.
            let predicted = (frames + 1) as f64 / *frames as f64;
            Ok((trials.len(), predicted * mean(&found.iter().map(|d| d.joints).collect_vec())))
        };
        lengths.iter().map(of).collect()
    }

    /// Returns logarithms of joint errors, `[trajectory][penalty]`, for trajectories outside the training folds. The
    /// logarithm keeps large errors from dominating.
    fn weighed(&self, learned: &Learned, ids: &[u64]) -> Result<Vec<Vec<f64>>> {
        let error = |id: &u64, weight: f64| -> Result<f64> {
            let told = self.told(learned, *id, Some(weight))?;
            Ok(self.errors(learned.log, *id, Some(&told), &[self.frames])?.1[0].ln())
        };
        ids.iter().map(|id| WEIGHTS.iter().map(|weight| error(id, *weight)).collect()).collect()
    }

    /// Chooses the penalty for each fold from the other folds. For each pair of folds, parameters are learned without
    /// both. Errors on one of them count for the penalty of the other.
    fn chosen(&self, logs: &[Log], folds: &[Vec<Vec<u64>>], progress: &mut dyn FnMut()) -> Result<Vec<f64>> {
        let count = folds.iter().map(Vec::len).max().unwrap_or(0);
        let mut sums = vec![[0.0; WEIGHTS.len()]; count];
        for (log, folds) in logs.iter().zip(folds) {
            for [a, b] in (0..folds.len()).array_combinations() {
                let learned = self.learned(log, &[&folds[a][..], &folds[b]].concat())?;
                for (fold, other) in [(a, b), (b, a)] {
                    for errors in self.weighed(&learned, &folds[other])? {
                        sums[fold].iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
                    }
                }
                progress();
            }
        }
        let best = |sums: &[f64; WEIGHTS.len()]| {
            sums.iter().zip(WEIGHTS).min_by(|a, b| a.0.total_cmp(b.0)).map_or(0.0, |(_, weight)| weight)
        };
        Ok(sums.iter().map(best).collect())
    }

    pub fn runs(&self) -> Result<Runs> {
        if self.context_frames == 0 || self.per_trajectory.is_empty() {
            bail!(
                "--per-trajectory, --regularized and --context-frames belong together: what a trajectory has of its own is \
                 fitted to the frames before its rollouts"
            );
        }
        if self.solver != Calibration::default().solver && self.solver != ["articulated"] {
            bail!("--per-trajectory: `articulated` is fitted by gradients; --solver says nothing of that");
        }
        bounds::once("--per-trajectory and --regularized", &[&self.per_trajectory[..], &self.regularized].concat())?;
        let logs: Vec<Log> = self.log.iter().map(|path| Log::read(path, self.data.as_deref())).try_collect()?;
        let notes = logs.iter().flat_map(|log| log.notes.clone()).collect_vec();
        notes.iter().for_each(|note| tell!("{note}"));
        if let Some(log) = logs.iter().find(|log| log.system.robot.floating() || log.system.robot.joint_count() == 0) {
            bail!(
                "--per-trajectory: `{}` has a free base or no joint; joints of a robot on a fixed base are compared",
                log.system.name
            );
        }
        let folds = logs.iter().map(|log| self.folds(log)).collect_vec();
        let lengths = [self.frames / 2, self.frames, 2 * self.frames];
        let least = if self.regularized.is_empty() { 2 } else { 3 };
        if let Some((log, _)) = logs.iter().zip(&folds).find(|(_, folds)| folds.len() < least) {
            bail!(
                "--splits: `{}` has too few folds: what is learned without one, and with --regularized without two, needs \
                 another",
                log.system.name
            );
        }
        let held = |n: usize| if self.regularized.is_empty() { 0 } else { n * (n - 1) / 2 };
        let bar = bar("folds", folds.iter().map(|folds| folds.len() + held(folds.len())).sum::<usize>() as u64);
        let [own, near] = [&self.per_trajectory, &self.regularized].map(|names| names.join(", "));
        let mut methods = ["no motion", "as described", "calibrated"].map(String::from).to_vec();
        methods.push(format!("calibrated, with its own {own}"));
        let mut weights = Vec::new();
        let mut judged = Vec::new();
        if !self.regularized.is_empty() {
            methods.extend([format!("and {near}"), format!("and {near}, held near what all share")]);
            weights = self.chosen(&logs, &folds, &mut || bar.add(1))?;
        }
        for ((log, path), folds) in logs.iter().zip(&self.log).zip(&folds) {
            for (fold, ids) in folds.iter().enumerate() {
                let learned = self.learned(log, ids)?;
                let (described, parameters) = self.subject(log, "articulated")?;
                let plain = fitted(&described, &parameters, &self.others(log, ids), self.config(1))?;
                for &id in ids {
                    let mut subjects =
                        vec![None, Some(described.clone()), Some(plain.clone()), Some(self.told(&learned, id, None)?)];
                    for weight in weights.get(fold).into_iter().flat_map(|weight| [0.0, *weight]) {
                        subjects.push(Some(self.told(&learned, id, Some(weight))?));
                    }
                    let mut run = Judged { log: stem(path), id, rollouts: Vec::new(), errors: Vec::new() };
                    for subject in &subjects {
                        let (rollouts, errors) = self.errors(log, id, subject.as_ref(), &lengths)?;
                        run.rollouts = rollouts;
                        run.errors.push(errors);
                    }
                    judged.push(run);
                }
                bar.add(1);
            }
        }
        bar.finish();
        if let Some(run) = judged.iter().find(|run| !run.errors.iter().flatten().all(|e| e.is_finite())) {
            bail!(
                "trajectory {}: no rollout of {} frames after the first {}; take fewer --frames",
                run.id,
                lengths[2],
                self.context_frames
            );
        }
        Ok(Runs { settings: self.clone(), notes, methods, lengths: lengths.into(), weights, judged })
    }

    /// Returns the folds that a log names, or else its trajectories dealt in turn to `splits` folds.
    fn folds(&self, log: &Log) -> Vec<Vec<u64>> {
        if !log.folds.is_empty() {
            return log.folds.clone();
        }
        let all = ids(log);
        (0..self.splits).map(|fold| all.iter().copied().skip(fold).step_by(self.splits).collect()).collect()
    }
}

/// Fits parameters of a subject to trials, and returns the calibrated subject.
fn fitted(subject: &Subject, parameters: &[Parameter], trials: &[Trial], config: FitConfig) -> Result<Subject> {
    let fit = subject.fit(parameters, trials, config, &mut |_, _| ())?;
    Ok(subject.with(parameters, &fit.values)?)
}

impl Runs {
    /// Returns `[value, low, high]` of `of` over all trajectories at a length. The 95 % interval comes from resampling
    /// trajectories with replacement.
    fn spread(&self, length: usize, of: impl Fn(&[&Judged], usize) -> f64) -> [f64; 3] {
        let all = self.judged.iter().collect_vec();
        let sets = resampled(&all, SETS, self.settings.seed, |runs| of(runs, length));
        [of(&all, length), percentile(sets.clone(), 0.025), percentile(sets, 0.975)]
    }

    pub(super) fn tables(&self) -> Vec<Table> {
        let error = |runs: &[&Judged], method: usize, length: usize| {
            mean(&runs.iter().map(|r| r.errors[method][length]).collect_vec())
        };
        let basis = BASIS + usize::from(self.methods.len() > BASIS + 2);
        let row = |method: usize| {
            let errors =
                (0..self.lengths.len()).map(|length| listed(self.spread(length, |runs, l| error(runs, method, l))));
            let gain = self.spread(1, |runs, l| 100.0 * (1.0 - error(runs, method, l) / error(runs, basis, l)));
            let gain = if method == basis { "-".into() } else { listed(gain) };
            [self.methods[method].clone()].into_iter().chain(errors).chain([gain]).collect_vec()
        };
        let lengths = self.lengths.iter().map(|frames| format!("{frames} frames"));
        let below = format!("below `{}` (%)", self.methods[basis]);
        let header = ["method".into()].into_iter().chain(lengths).chain([below]);
        let settings = &self.settings;
        let errors = Table::new("errors", header)
            .with((0..self.methods.len()).map(row))
            .noted(format!(
                "Open loop from measured states, every {} frames from frame {} on; mean error of the joints (rad or m) over rollouts and their frames, \
                 then over {} trajectories [95 % interval from drawing trajectories]. What all share was fitted to the other folds, what a \
                 trajectory has of its own to its first {} frames. Last column: at {} frames, paired by trajectory. Cost of leaving what all \
                 share, by fold, chosen within the other folds: {}.{}",
                settings.every,
                settings.context_frames,
                self.judged.len(),
                settings.context_frames,
                self.lengths[1],
                self.weights.iter().map(|w| digits(*w)).join(", "),
                self.notes.iter().map(|n| format!(" {n}.")).collect::<String>()
            ));
        let header = ["log", "trajectory", "rollouts"].into_iter().chain(self.methods.iter().map(String::as_str));
        let row = |run: &Judged| {
            let errors = run.errors.iter().map(|e| digits(e[1]));
            [run.log.clone(), run.id.to_string(), run.rollouts[1].to_string()].into_iter().chain(errors).collect_vec()
        };
        let runs = Table::new("trajectories", header)
            .with(self.judged.iter().map(row))
            .noted(format!("Mean error at {} frames of each trajectory.", self.lengths[1]));
        vec![errors, runs]
    }
}
