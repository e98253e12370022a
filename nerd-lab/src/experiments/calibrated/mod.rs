//! Analytic solvers calibrated to measured trajectories, cross-validated over splits by trajectory ([`nerd_sim::calibrate`]).

mod fit;
mod floors;
mod panels;
mod split;
mod tables;

use std::path::{Path, PathBuf};

use nerd_model::pick;
use nerd_sim::log::{Published, specified};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::Experiment;
use crate::error::Result;
use crate::report::inputs::hex;
use crate::report::{Input, Inputs, Table};
use nerd_train::bounds::{FRAMES, SEEDS, STARTS};
use nerd_train::settings::settings;

pub use split::{Scored, Split};

use split::Parts;

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
        /// Result of a calibration with the same splits (its JSON) from whose fits the searches go on, for example with more substeps
        begin: Option<PathBuf> = None, Text;
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
    /// Falling through the ground.
    #[serde(default)]
    pub falling: Vec<Scored>,
    /// How far the first solver's rollouts are from those that begin a frame later: what the noise of starts alone makes.
    #[serde(default)]
    pub noise: Vec<Scored>,
    /// What others published.
    #[serde(default)]
    pub published: Vec<Published>,
    /// By solver.
    pub fitted: Vec<Calibrated>,
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
            all.update(std::fs::read(path).map_err(crate::error::file(path))?);
        }
        all.update(system.sha256());
        let mut inputs = Inputs(vec![Input::Data { name: self.name(), sha256: hex(&all.finalize()) }]);
        for fits in self.fits.iter().chain(&self.begin) {
            inputs.add(Input::files("fits", std::slice::from_ref(fits))?);
        }
        // Of every robot: what is hashed is how the solver steps.
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
        let seeds = self.seed..self.seed + self.splits as u64;
        let parts: Vec<Parts> = seeds.clone().map(|seed| Parts::new(&log, &trials, self.train, seed)).collect::<Result<_>>()?;
        let sizes = [log.trajectories.len(), trials.len()];
        let still = parts.iter().zip(seeds).map(|(part, seed)| part.still(&log, seed)).collect();
        let falling = self.falling(&log, &parts)?;
        let fitted = self.fitted(&log, sizes, &parts)?;
        let noise = self.noise(&log, &fitted, &parts)?;
        let (settings, robot) = (self.clone(), log.system.name.clone());
        let (notes, published) = (log.notes, log.published);
        Ok(CalibratedAll { settings, robot, notes, sizes, still, falling, noise, published, fitted })
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
