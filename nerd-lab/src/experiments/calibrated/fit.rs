//! Fits of the solvers to each split, made now or before.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use nerd_sim::calibrate::{Engine, Fit, FitConfig, Parameter, Subject, Trial, mean, thinned};
use nerd_sim::log::Log;
use nerd_sim::prelude::*;
use rayon::prelude::*;

use super::{Calibrated, CalibratedAll, Calibration, Split, split};
use crate::error::{Error, Result, refuse};
use nerd_train::progress::bar;

/// Places of a profile, and rollouts behind each.
const PLACES: usize = 9;
const BEHIND: usize = 200;

impl Calibration {
    pub(super) fn log(&self) -> Result<Log> {
        Ok(Log::read(&self.log, self.data.as_deref())?)
    }

    fn engine(&self, solver: &str) -> Result<Engine> {
        match solver {
            "articulated" => Ok(Engine::Articulated(ArticulatedConfig::implicit(self.substeps, Friction::Coulomb))),
            "rapier" => Ok(Engine::Rapier(RapierConfig { steps: 1, ..Default::default() })),
            other => refuse!("--solvers {other}: known are articulated, rapier"),
        }
    }

    /// A solver's parameters, and what they are of.
    pub(super) fn subject(&self, log: &Log, solver: &str) -> Result<(Subject, Vec<Parameter>)> {
        let subject = Subject::new(&log.system, &log.scene, self.engine(solver)?)?;
        let twice = |names: &[String]| (1..names.len()).find(|&k| names[..k].contains(&names[k])).map(|k| names[k].clone());
        if let Some(name) = twice(&self.parameters).or_else(|| twice(&self.solvers)) {
            refuse!("`{name}` is named twice");
        }
        let parameters: Vec<Parameter> = match &self.parameters[..] {
            [] => Parameter::usual(&log.system, &log.scene, solver == "rapier")?,
            names => names.iter().map(|name| Parameter::named(&log.system, name)).collect::<std::result::Result<_, _>>()?,
        };
        // What a solver does not have is said before anything is searched.
        subject.with(&parameters, &parameters.iter().map(|p| p.nominal).collect::<Vec<_>>())?;
        Ok((subject, parameters))
    }

    /// How the fits of split `k` are searched.
    pub(super) fn fit_config(&self, k: u64) -> FitConfig {
        FitConfig { evaluations: self.evaluations, trials: self.trials, seed: self.seed + k }
    }

    /// A solver's name in tables.
    fn title(&self, solver: &str) -> String {
        if solver == "articulated" { format!("articulated implicit x{}", self.substeps) } else { solver.into() }
    }

    /// `from`: fits of the same splits, from which the searches go on.
    fn calibrated(&self, log: &Log, solver: &str, parts: &[split::Parts], from: Option<&Calibrated>) -> Result<Calibrated> {
        let (subject, parameters) = self.subject(log, solver)?;
        let (bar, done) = (bar(solver, (parts.len() * self.evaluations) as u64), AtomicU64::new(0));
        let one = |(k, part): (u64, &split::Parts)| -> Result<(Split, Vec<Vec<[f64; 2]>>)> {
            let mut before = 0;
            let progress = &mut |own: usize, _| {
                let more = own.saturating_sub(before) as u64;
                bar.set(done.fetch_add(more, Ordering::Relaxed) + more);
                before = own;
            };
            let fit = match from.and_then(|from| from.splits.get(k as usize)) {
                Some(split) => subject.refine(&parameters, &part.train, self.fit_config(k), &split.fit.values, progress)?,
                None => subject.fit(&parameters, &part.train, self.fit_config(k), progress)?,
            };
            let (fitted, mut profiles) = (subject.with(&parameters, &fit.values)?, Vec::new());
            if k == 0 {
                let some: Vec<Trial> = thinned(&part.train, BEHIND);
                let own = Fit { before: mean(&subject.distances(&some)?), ..fit.clone() };
                profiles = subject.profiles(&parameters, &own, &some, PLACES)?;
            }
            Ok((part.split(&subject, &fitted, fit, self.seed + k)?, profiles))
        };
        let found = parts.par_iter().enumerate().map(|(k, part)| one((k as u64, part))).collect::<Result<Vec<_>>>()?;
        let (splits, profiles): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        let profiles = profiles.into_iter().next().unwrap_or_default();
        bar.finish();
        if !splits.iter().all(|s: &Split| s.fit.objective.is_finite()) || profiles.iter().flatten().any(|p| !p[1].is_finite()) {
            refuse!("{solver}: a rollout ends in no number; the log's numbers are too large, or a parameter's bounds too wide");
        }
        Ok(Calibrated { solver: self.title(solver), parameters: described(&parameters), splits, profiles })
    }

    /// The solvers, calibrated now or before.
    pub(super) fn fitted(&self, log: &Log, sizes: [usize; 2], parts: &[split::Parts]) -> Result<Vec<Calibrated>> {
        let taken = |path, option| self.taken(path, option, log, sizes, parts);
        match (&self.fits, &self.begin) {
            (Some(_), Some(_)) => refuse!("--fits takes fits as they are, --begin goes on from them: name one"),
            (Some(path), None) => taken(path, "--fits"),
            (None, Some(path)) => {
                let before = taken(path, "--begin")?;
                self.solvers.iter().zip(&before).map(|(solver, from)| self.calibrated(log, solver, parts, Some(from))).collect()
            }
            (None, None) => self.solvers.iter().map(|solver| self.calibrated(log, solver, parts, None)).collect(),
        }
    }

    /// Fits of an earlier result, if they are of the very same.
    fn taken(&self, path: &Path, option: &str, log: &Log, sizes: [usize; 2], parts: &[split::Parts]) -> Result<Vec<Calibrated>> {
        let text = std::fs::read_to_string(path).map_err(crate::error::file(path))?;
        let found: CalibratedAll = serde_json::from_str(&text).map_err(|e| Error::msg(format!("{option} {}: {e}", path.display())))?;
        let differ = |what: &str| Err(Error::msg(format!("{option} {}: made with {what}", path.display())));
        let of = &found.settings;
        if (&found.robot, found.sizes, of.frames, of.every) != (&log.system.name, sizes, self.frames, self.every) {
            return differ("another log, or rollouts cut otherwise");
        }
        let mut taken = Vec::new();
        for solver in &self.solvers {
            // Searches may go on with other substeps.
            let fits = |f: &&Calibrated| f.solver == self.title(solver) || option == "--begin" && f.solver.starts_with(solver.as_str());
            let Some(fitted) = found.fitted.iter().find(fits) else {
                return differ(&format!("other solvers: it has no {}", self.title(solver)));
            };
            let mut fitted = fitted.clone();
            if !same(&fitted.parameters, &described(&self.subject(log, solver)?.1)) {
                return differ("other parameters; name its own with --parameters");
            }
            if fitted.splits.len() < parts.len() || fitted.splits.iter().zip(parts).any(|(split, part)| split.judged != part.ids()) {
                return differ("other splits");
            }
            fitted.splits.truncate(parts.len());
            taken.push(fitted);
        }
        Ok(taken)
    }
}

/// Names, bounds around the nominal values, and units.
fn described(parameters: &[Parameter]) -> Vec<(String, [f64; 3], String)> {
    parameters.iter().map(|p| (p.name.clone(), [p.low, p.nominal, p.high], p.unit.into())).collect()
}

/// Equal to the last digits that a file may round.
fn same(a: &[(String, [f64; 3], String)], b: &[(String, [f64; 3], String)]) -> bool {
    let near = |(x, y): (&f64, &f64)| (x - y).abs() <= 1e-12 * x.abs().max(y.abs());
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.0 == b.0 && a.1.iter().zip(&b.1).all(near))
}
