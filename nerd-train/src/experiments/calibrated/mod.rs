//! Analytic solvers calibrated to measured trajectories, cross-validated over splits by trajectory ([`nerd_sim::calibrate`]).

mod learn;
mod panels;
mod split;
mod tables;

use std::path::{Path, PathBuf};

use nerd_model::pick;
use nerd_sim::calibrate::{Engine, Fit, FitConfig, Parameter, Subject, Trial, thinned};
use nerd_sim::log::{Log, specified};
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::Experiment;
use crate::bounds::{FRAMES, SEEDS, STARTS};
use crate::error::{Error, Result, refuse};
use crate::progress::bar;
use crate::report::inputs::hex;
use crate::report::{Input, Inputs, Table};
use crate::settings::settings;

pub use learn::Learned;
pub use split::{Scored, Split};

settings! {
    /// Analytic solvers calibrated to measured trajectories.
    pub struct Calibration {
        /// TOML that describes the measurements; see `nerd_sim::log`
        log: PathBuf = "nerd-sim/assets/logs/cube.log.toml".into(), Text;
        /// Their table [default: the one that the TOML names]
        data: Option<PathBuf> = None, Text;
        /// Name of the result [default: calibrate- and the TOML's first word]
        name: String = String::new(), Text;
        /// Solvers, comma-separated: articulated, rapier
        solvers: Vec<String> = vec!["articulated".into(), "rapier".into()], Texts;
        /// Substeps of `articulated` (the implicit step)
        substeps: usize = 4, Whole(1..=1024);
        /// Parameters, comma-separated [default: all that free motion may determine]
        parameters: Vec<String> = Vec::new(), Texts;
        /// Random splits by trajectory: fitted to one part, judged on another
        splits: usize = 5, Whole(1..=100);
        /// Share of the trajectories that are fitted to (%); half of the rest is judged on (the paper: 400 and 85 of 570)
        train: usize = 68, Whole(1..=95);
        /// Frames of a rollout
        frames: usize = 80, Whole(2..=*FRAMES.end());
        /// A rollout begins at every so many frames
        every: usize = 4, Whole(FRAMES);
        /// Evaluations of the objective, for each split and solver
        evaluations: usize = 1000, Whole(40..=1_000_000);
        /// Rollouts in an evaluation
        trials: usize = 500, Whole(STARTS);
        /// Result of a calibration with the same splits (its JSON) whose fits are taken: nothing is fitted anew
        fits: Option<PathBuf> = None, Text;
        /// What is learned beyond the calibration of articulated, comma-separated: residual, residual-single, pretrained, paper,
        /// fine-tuned, real-only [default: nothing]
        learn: Vec<String> = Vec::new(), Texts;
        /// With --learn: width of the network
        embedding: usize = 64, Whole(16..=1024);
        /// With --learn: its layers
        layers: usize = 2, Whole(1..=16);
        /// With --learn: frames of a rollout in training
        sequence: usize = 32, Whole(2..=1000);
        /// With --learn: updates over many frames
        updates: u64 = 400, Whole(1..=1_000_000);
        /// With --learn: updates on single frames
        singles: u64 = 3000, Whole(1..=10_000_000);
        /// Seed of splits and search
        seed: u64 = 0, Whole(SEEDS);
    }
}

/// One solver, calibrated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibrated {
    /// Its name in tables.
    pub solver: String,
    /// Names of its parameters, with bounds, nominal value and unit.
    pub parameters: Vec<(String, [f64; 3], String)>,
    /// By split.
    pub splits: Vec<Split>,
    /// The objective along each parameter of the first split: values, and the objective there.
    pub profiles: Vec<Vec<[f64; 2]>>,
}

/// All of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibratedAll {
    /// What was asked for.
    #[serde(flatten)]
    pub settings: Calibration,
    /// Robot of the log.
    pub robot: String,
    /// What reading the log had to say.
    pub notes: Vec<String>,
    /// Trajectories, and rollouts cut from them.
    pub sizes: [usize; 2],
    /// Predicting that nothing moves, on the judged part of every split.
    pub still: Vec<Scored>,
    /// By solver.
    pub fitted: Vec<Calibrated>,
    /// By way of learning, on the first solver.
    #[serde(default)]
    pub learned: Vec<Learned>,
}

/// Places of a profile, and rollouts behind each.
const PLACES: usize = 9;
const BEHIND: usize = 200;

impl Calibration {
    fn log(&self) -> Result<Log> {
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
    fn subject(&self, log: &Log, solver: &str) -> Result<(Subject, Vec<Parameter>)> {
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
                let own = Fit { before: nerd_sim::calibrate::mean(&subject.distances(&some)?), ..fit.clone() };
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
}

impl Calibration {
    /// The solvers, calibrated now or before.
    fn fitted(&self, log: &Log, parts: &[split::Parts]) -> Result<Vec<Calibrated>> {
        let Some(path) = &self.fits else {
            return self.solvers.iter().map(|solver| self.calibrated(log, solver, parts)).collect();
        };
        let text = std::fs::read_to_string(path).map_err(Error::file(path))?;
        let mut found: CalibratedAll = serde_json::from_str(&text).map_err(|e| Error::Refused(format!("--fits {}: {e}", path.display())))?;
        let same = |fitted: &Calibrated| {
            fitted.splits.len() >= parts.len() && fitted.splits.iter().zip(parts).all(|(split, part)| split.judged == part.ids())
        };
        let alike = |of: &Self| (of.solvers.clone(), of.parameters.clone(), of.substeps);
        if alike(&found.settings) != alike(self) || !found.fitted.iter().all(same) {
            refuse!("--fits {}: made with other solvers, substeps, parameters or splits", path.display());
        }
        found.fitted.iter_mut().for_each(|fitted| fitted.splits.truncate(parts.len()));
        Ok(found.fitted)
    }

    /// What is learned beyond the first solver's calibration.
    fn learned(&self, log: &Log, fitted: &[Calibrated], parts: &[split::Parts]) -> Result<Vec<Learned>> {
        let new = |way: &String| Learned { way: way.clone(), after: Vec::new(), whole: Vec::new(), simulated: Vec::new() };
        let mut all: Vec<Learned> = self.learn.iter().map(new).collect();
        let (Some(first), Some(solver)) = (fitted.first().filter(|_| !all.is_empty()), self.solvers.first()) else { return Ok(all) };
        let (subject, parameters) = self.subject(log, solver)?;
        for (k, (split, parts)) in first.splits.iter().zip(parts).enumerate() {
            let seed = self.seed + k as u64;
            let Self { embedding, layers, sequence, updates, singles, .. } = *self;
            let effort = learn::Effort { embedding, layers, sequence, updates, singles, seed };
            let calibrated = subject.with(&parameters, &split.fit.values)?;
            let pupil = learn::Pupil { log, subject: &calibrated, parameters: &parameters, values: &split.fit.values, parts, effort };
            for (row, model) in all.iter_mut().zip(pupil.learn(&self.learn)?) {
                let (after, whole, simulated) = pupil.judged(&model, seed)?;
                eprintln!("split {k}, {}: {:.5} m, {:.4} rad", row.way, after.mean.position, after.mean.rotation);
                row.after.push(after);
                row.whole.push(whole);
                row.simulated.push(simulated);
            }
        }
        Ok(all)
    }
}

impl Experiment for Calibration {
    type Data = CalibratedAll;

    fn name(&self) -> String {
        let stem = self.log.file_name().map(|n| n.to_string_lossy().split('.').next().unwrap_or_default().to_string());
        if self.name.is_empty() { format!("calibrate-{}", stem.unwrap_or_default()) } else { self.name.clone() }
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        (self.splits * self.solvers.len() * self.evaluations * self.trials) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let (spec, system) = specified(&self.log)?;
        let table = self.data.clone().unwrap_or_else(|| self.log.with_file_name(spec.file));
        let mut all = Sha256::new();
        for path in [&self.log, &table] {
            all.update(std::fs::read(path).map_err(Error::file(path))?);
        }
        all.update(system.sha256());
        let mut inputs = Inputs(vec![Input::Data { name: self.name(), sha256: hex(&all.finalize()) }]);
        for solver in &self.solvers {
            let setting = if solver == "rapier" { pick::Setting::RapierSteps(1) } else { pick::Setting::Implicit(self.substeps) };
            inputs.add(Input::motion("cube", "ground", &setting)?);
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<CalibratedAll> {
        let log = self.log()?;
        log.notes.iter().for_each(|note| eprintln!("{note}"));
        self.solvers.iter().try_for_each(|solver| self.subject(&log, solver).map(|_| ()))?;
        let trials = log.trials(self.frames, self.every);
        let parts: Vec<split::Parts> =
            (0..self.splits).map(|k| split::Parts::new(&log, &trials, self.train, self.seed + k as u64)).collect::<Result<_>>()?;
        let still = parts.iter().enumerate().map(|(k, part)| part.still(&log, self.seed + k as u64)).collect();
        let fitted = self.fitted(&log, &parts)?;
        let learned = self.learned(&log, &fitted, &parts)?;
        let sizes = [log.trajectories.len(), trials.len()];
        Ok(CalibratedAll { settings: self.clone(), robot: log.system.name.clone(), notes: log.notes, sizes, still, fitted, learned })
    }

    fn tables(&self, data: &CalibratedAll) -> Result<Vec<Table>> {
        Ok(vec![data.errors(), data.parameters()])
    }

    fn pictures(&self, data: &CalibratedAll, stem: &Path) -> Result<()> {
        match data.fitted.first() {
            Some(solver) if !solver.profiles.is_empty() => panels::draw(solver, stem),
            _ => Ok(()),
        }
    }
}
