//! Fits of the solvers to each split, made now or before.

use nerd_sim::calibrate::{Engine, Fit, FitConfig, Parameter, Subject, Trial, mean, thinned};
use nerd_sim::log::Log;
use nerd_sim::prelude::*;

use super::{Calibrated, CalibratedAll, Calibration, split};
use crate::error::{Error, Result, refuse};
use crate::progress::bar;

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
            [] => Parameter::usual(&log.system, solver == "rapier")?,
            names => names.iter().map(|name| Parameter::named(&log.system, name)).collect::<std::result::Result<_, _>>()?,
        };
        // What a solver does not have is said before anything is searched.
        subject.with(&parameters, &parameters.iter().map(|p| p.nominal).collect::<Vec<_>>())?;
        Ok((subject, parameters))
    }

    fn calibrated(&self, log: &Log, solver: &str, parts: &[split::Parts]) -> Result<Calibrated> {
        let (subject, parameters) = self.subject(log, solver)?;
        let bar = bar(solver, (parts.len() * self.evaluations) as u64);
        let mut splits = Vec::new();
        let mut profiles = Vec::new();
        for (k, part) in parts.iter().enumerate() {
            let config = FitConfig { evaluations: self.evaluations, trials: self.trials, seed: self.seed + k as u64 };
            let fit = subject.fit(&parameters, &part.train, config, &mut |done, _| bar.set((k * self.evaluations + done) as u64))?;
            let fitted = subject.with(&parameters, &fit.values)?;
            if k == 0 {
                let some: Vec<Trial> = thinned(&part.train, BEHIND);
                let own = Fit { before: mean(&subject.distances(&some)?), ..fit.clone() };
                profiles = subject.profiles(&parameters, &own, &some, PLACES)?;
            }
            splits.push(part.judged(&subject, &fitted, fit, self.seed + k as u64)?);
        }
        bar.finish();
        if !splits.iter().all(|s| s.fit.objective.is_finite()) || profiles.iter().flatten().any(|p| !p[1].is_finite()) {
            refuse!("{solver}: a rollout ends in no number; the log's numbers are too large, or a parameter's bounds too wide");
        }
        let name = if solver == "articulated" { format!("articulated implicit x{}", self.substeps) } else { solver.into() };
        let parameters = parameters.into_iter().map(|p| (p.name, [p.low, p.nominal, p.high], p.unit.into()));
        Ok(Calibrated { solver: name, parameters: parameters.collect(), splits, profiles })
    }

    /// The solvers, calibrated now or before.
    pub(super) fn fitted(&self, log: &Log, parts: &[split::Parts]) -> Result<Vec<Calibrated>> {
        let Some(path) = &self.fits else {
            return self.solvers.iter().map(|solver| self.calibrated(log, solver, parts)).collect();
        };
        let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
        let mut found: CalibratedAll =
            serde_json::from_str(&text).map_err(|e| Error::Refused(format!("--fits {}: {e}", path.display())))?;
        let same = |fitted: &Calibrated| {
            fitted.splits.len() >= parts.len() && fitted.splits.iter().zip(parts).all(|(split, part)| split.judged == part.ids())
        };
        // Which parameters are the usual ones may have changed since.
        for (solver, fitted) in self.solvers.iter().zip(&found.fitted) {
            let (_, parameters) = self.subject(log, solver)?;
            if !parameters.iter().map(|p| &p.name).eq(fitted.parameters.iter().map(|p| &p.0)) {
                refuse!("--fits {}: made with other parameters; name its own with --parameters", path.display());
            }
        }
        let alike = |of: &Self| (of.solvers.clone(), of.parameters.clone(), of.substeps);
        if alike(&found.settings) != alike(self) || !found.fitted.iter().all(same) {
            refuse!("--fits {}: made with other solvers, substeps, parameters or splits", path.display());
        }
        found.fitted.iter_mut().for_each(|fitted| fitted.splits.truncate(parts.len()));
        Ok(found.fitted)
    }
}
