//! Calibrates analytic solvers to measured trajectories, cross-validated over splits by trajectory
//! ([`nerd_sim::calibrate`]).

mod models;
mod runs;
mod split;
mod tables;

use crate::prelude::*;
use crate::roll::refusal;
pub use models::Modelled;
use nerd_sim::calibrate::{Engine, Fit, FitConfig, Parameter, Subject, Trial, mean, thinned};
use nerd_sim::log::{Log, Published, specified, tables};
pub use runs::{Judged, Runs};
use split::{Parts, Scored, Split};

/// Number of values along each parameter's profile.
const PLACES: usize = 9;
/// Most rollouts over which each value of a profile is averaged.
const BEHIND: usize = 200;

settings! {
    /// Settings of an experiment that calibrates analytic solvers to measured trajectories.
    pub struct Calibration {
        /// TOML of a log, which describes the measurements (`nerd_sim::log`). With --per-trajectory: several,
        /// comma-separated, each calibrated separately [default: nerd-sim/assets/logs/cube.log.toml]
        log: Vec<PathBuf> = vec!["nerd-sim/assets/logs/cube.log.toml".into()], Texts;
        /// Table of measurements, or a folder of tables [default: the file named in the TOML]
        data: Option<PathBuf> = None, Text;
        /// Name of the result [default: calibrate- and the TOML's file name up to its first dot]
        name: String = String::new(), Text;
        /// Solvers to calibrate, comma-separated: articulated (fitted by gradients where the robot has them) or rapier
        /// (fitted by a search) [default: articulated,rapier]
        solver: Vec<String> = vec!["articulated".into(), "rapier".into()], Read(readable);
        /// Substeps per frame of `articulated`, which takes implicit steps
        substeps: usize = 4, Whole(1..=1024);
        /// Parameters to fit, comma-separated [default: all that the log's motion can determine]
        parameters: Vec<String> = Vec::new(), Texts;
        /// Parameters fitted to each trajectory separately, comma-separated, such as sensor zeros set by hand. In a
        /// test trajectory, its first --context-frames frames determine them. The other parameters are fitted to the
        /// other folds. The log may name the folds; else there are --splits folds. Every trajectory is tested once, in
        /// rollouts of half, once and twice --frames
        per_trajectory: Vec<String> = Vec::new(), Texts;
        /// With --per-trajectory: further parameters fitted to each trajectory, comma-separated, with a penalty on
        /// leaving the shared value. Outside --parameters, the penalty is on leaving the described value. Its weight is
        /// chosen within the training folds
        regularized: Vec<String> = Vec::new(), Texts;
        /// With --per-trajectory: first frames of a trajectory, to which its own parameters are fitted. Test
        /// rollouts start after them
        context_frames: usize = 0, Whole(0..=*FRAMES.end());
        /// Folders of models, comma-separated, of the log's robot or of a family that varies its parameters. Each is
        /// tested with the frames before a rollout as history, and without. A model trained on the log is tested on its
        /// held-out trajectories [default: none]
        model: Vec<PathBuf> = Vec::new(), Texts;
        /// Number of random splits by trajectory. Each fits to 68 % and tests on half of the rest (the paper: 400 and
        /// 85 of 570)
        splits: usize = 5, Whole(1..=100);
        /// Frames of a rollout
        frames: usize = 80, Whole(2..=*FRAMES.end());
        /// Frames between the starts of rollouts
        every: usize = 4, Whole(FRAMES);
        /// Evaluations of the objective for each split and solver
        evaluations: usize = 1000, Whole(40..=1_000_000);
        /// Largest number of rollouts in an evaluation of the objective
        rollouts: usize = 500, Whole(STARTS);
        /// Seed of the splits and of the search
        seed: u64 = 0, Whole(SEEDS);
    }
}

#[derive(Serialize, Deserialize)]
pub struct Calibrated {
    pub solver: String,
    /// Fitting method: `slopes` (by gradients) or `search`.
    pub by: String,
    /// Parameters as (name, `[lower bound, nominal, upper bound]`, unit).
    pub parameters: Vec<(String, [f64; 3], String)>,
    pub splits: Vec<Split>,
    /// Objective of the first split along each parameter: `[parameter][k]` is the pair `[value, objective]` at the
    /// parameter's k-th value.
    pub profiles: Vec<Vec<[f64; 2]>>,
}

#[derive(Serialize, Deserialize)]
pub struct CalibratedAll {
    #[serde(flatten)]
    pub settings: Calibration,
    pub robot: String,
    pub notes: Vec<String>,
    /// Number of trajectories, and number of rollouts cut from them.
    pub sizes: [usize; 2],
    /// Error of predicting no motion (the start, repeated), on the test part of every split.
    pub still: Vec<Scored>,
    #[serde(default)]
    pub published: Vec<Published>,
    pub fitted: Vec<Calibrated>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modelled: Vec<Modelled>,
}

/// Refuses a text that names no solver.
fn readable(solver: &str) -> Result<(), String> {
    solver.parse::<SolverSpec>().map(drop).map_err(|error| error.to_string())
}

/// Returns the engine to calibrate, with a solver's settings.
pub fn engine(spec: &SolverSpec, system: &System) -> Result<Engine> {
    Ok(match spec {
        SolverSpec::Rapier(own) => Engine::Rapier(own.config()),
        own => Engine::Articulated(
            own.config(system).with_context(|| format!("--solver {spec}: choose from articulated, rapier"))?,
        ),
    })
}

impl Calibration {
    /// Parses a solver; `articulated` without settings gets --substeps.
    fn spec(&self, solver: &str) -> Result<SolverSpec> {
        let spec: SolverSpec = solver.parse()?;
        let settled = matches!(spec, SolverSpec::Articulated(own) if own.settled);
        if settled || spec.device() != Device::Cpu || spec.is_neural() {
            bail!("--solver {spec}: choose from articulated and rapier on the CPU, without settled");
        }
        Ok(if spec == SolverSpec::default() { SolverSpec::implicit(self.substeps) } else { spec })
    }

    fn subject(&self, log: &Log, solver: &str) -> Result<(Subject, Vec<Parameter>)> {
        let subject = Subject::new(&log.system, &log.scene, engine(&self.spec(solver)?, &log.system)?)?;
        let parameters: Vec<Parameter> = match &self.parameters[..] {
            [] => {
                let driven = if log.driven() { Parameter::driven(&log.system)? } else { Vec::new() };
                let all =
                    Parameter::usual(&log.system, &log.scene, solver.starts_with("rapier"))?.into_iter().chain(driven);
                all.filter(|p| !self.per_trajectory.contains(&p.name)).collect()
            }
            names => names.iter().map(|name| Parameter::named(&log.system, name)).try_collect()?,
        };
        // Reports missing capabilities before any search.
        if let Some(reason) = refusal(&mut *subject.engine.solver(), &subject.system, &subject.scene) {
            bail!(reason);
        }
        subject.with(&parameters, &parameters.iter().map(|p| p.nominal).collect_vec())?;
        Ok((subject, parameters))
    }

    fn calibrated(&self, log: &Log, solver: &str, parts: &[Parts]) -> Result<Calibrated> {
        let (subject, parameters) = self.subject(log, solver)?;
        let bar = bar(solver, (parts.len() * self.evaluations) as u64);
        let one = |(k, part): (u64, &Parts)| -> Result<(Split, Fit)> {
            let mut before = 0;
            let progress = &mut |own: usize, _| {
                bar.add(own.saturating_sub(before) as u64);
                before = own;
            };
            let evaluations = self.evaluations;
            let trials = self.rollouts;
            let seed = self.seed + k;
            let config = FitConfig { evaluations, trials, seed, gradients: true };
            let begun = Instant::now();
            let fit = subject.fit(&parameters, &part.train, config, progress)?;
            let seconds = begun.elapsed().as_secs_f64();
            let fitted = subject.with(&parameters, &fit.values)?;
            Ok((part.split([&subject, &fitted], (&fit, seconds), seed)?, fit))
        };
        // Runs splits one after the other, so that each is timed alone; trials use all cores.
        let found: Vec<_> = (0..).zip(parts).map(one).try_collect()?;
        let some: Vec<Trial> = thinned(&parts[0].train, BEHIND);
        let own = Fit { before: mean(&subject.distances(&some)?), ..found[0].1.clone() };
        let profiles = subject.profiles(&parameters, &own, &some, PLACES)?;
        let splits = found.into_iter().map(|(split, _)| split).collect_vec();
        bar.finish();
        if !splits.iter().all(|s| s.fit.objective.is_finite()) || profiles.iter().flatten().any(|p| !p[1].is_finite()) {
            bail!(
                "{solver}: a rollout ends in no number; the log's numbers are too large, or a parameter's bounds too wide"
            );
        }
        let solver = self.spec(solver)?.to_string();
        let parameters =
            parameters.iter().map(|p| (p.name.clone(), [p.low, p.nominal, p.high], p.unit.into())).collect();
        let by = if own.gradients { "slopes" } else { "search" }.into();
        Ok(Calibrated { solver, by, parameters, splits, profiles })
    }

    pub fn all(&self) -> Result<CalibratedAll> {
        let [path] = &self.log[..] else {
            bail!("--log: without --per-trajectory one log is fitted to, not {}", self.log.len())
        };
        let log = Log::read(path, self.data.as_deref())?;
        log.notes.iter().for_each(|note| tell!("{note}"));
        bounds::once("--parameters", &self.parameters)?;
        bounds::once("--solver", &self.solver)?;
        self.solver.iter().try_for_each(|solver| self.spec(solver).map(drop))?;
        let ready = able(&self.solver, |solver| self.subject(&log, solver).map(|_| solver))?;
        let trials = log.trials(self.frames, self.every);
        let seeds = self.seed..self.seed + self.splits as u64;
        let parts: Vec<Parts> = seeds.clone().map(|seed| Parts::new(&log, &trials, seed)).collect::<Result<_>>()?;
        let still = parts.iter().zip(seeds).map(|(part, seed)| part.still(&log, seed)).collect();
        let fitted = able(&ready, |solver| self.calibrated(&log, solver, &parts))?;
        let modelled = self.modelled(&log, &parts)?;
        let sizes = [log.trajectories.len(), trials.len()];
        let robot = log.system.name.clone();
        Ok(CalibratedAll {
            settings: self.clone(),
            robot,
            notes: log.notes,
            sizes,
            still,
            published: log.published,
            fitted,
            modelled,
        })
    }
}

/// Returns the results of `of` for the solvers that succeed. The others are reported and left out; if all fail, the
/// last error is returned.
fn able<'a, T>(solvers: &'a [impl AsRef<str>], of: impl Fn(&'a str) -> Result<T>) -> Result<Vec<T>> {
    let tried = solvers
        .iter()
        .map(AsRef::as_ref)
        .map(|solver| of(solver).inspect_err(|reason| tell!("{solver}: left out, {reason:#}")));
    let (found, mut failed): (Vec<T>, Vec<Error>) = tried.partition_result();
    match failed.pop() {
        Some(reason) if found.is_empty() => Err(reason),
        _ => Ok(found),
    }
}

/// A file's name up to the first dot.
fn stem(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().split('.').next().unwrap_or_default().into()
}

impl Experiment for Calibration {
    fn about(&self) -> Result<About> {
        let Some(first) = self.log.first() else { bail!("--log: name the TOML of a log") };
        let name = if self.name.is_empty() { format!("calibrate-{}", stem(first)) } else { self.name.clone() };
        let mut inputs = Inputs::default();
        let mut files = Vec::new();
        for log in &self.log {
            let (spec, system) = specified(log)?;
            let table = self.data.clone().unwrap_or_else(|| log.with_file_name(spec.file));
            files.extend([log.clone()].into_iter().chain(tables(&table)?));
            inputs.add(Input::Data { name: system.name.clone(), sha256: system.sha256() });
        }
        inputs.0.insert(0, Input::files(&name, &files)?);
        // Identifies the solver by its motion on one robot and scene, whatever the log's robot is.
        for solver in &self.solver {
            inputs.add(Input::motion("cube", "ground", &self.spec(solver)?)?);
        }
        inputs.models(&self.model)?;
        let effort = (self.splits * self.solver.len() * self.evaluations * self.rollouts) as f64;
        Ok(About { name, seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        if !(self.per_trajectory.is_empty() && self.regularized.is_empty() && self.context_frames == 0) {
            if !self.model.is_empty() {
                bail!(
                    "--model is judged beside what all trajectories share: leave --per-trajectory, --regularized and \
                     --context-frames out"
                );
            }
            let found = self.runs()?;
            return Measured::new(&found, found.tables());
        }
        let found = self.all()?;
        let first = found.fitted.first().filter(|solver| !solver.profiles.is_empty());
        let tables = vec![found.errors(), found.fits(), found.parameters()];
        Ok(Measured::new(&found, tables)?.with("figure", first.map(Calibrated::figure)))
    }
}

impl Calibrated {
    fn figure(&self) -> Figure {
        let panel = |k: usize| {
            let (profile, (name, _, unit), at) = (&self.profiles[k], &self.parameters[k], self.splits[0].fit.values[k]);
            let points = profile.iter().map(|p| (p[0], p[1].min(1.5))).collect_vec();
            let ends = points.iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.1), b.max(p.1)));
            let series = vec![
                Series::new("objective", Style::Line, points),
                Series::new("fit", Style::Dashed, [(at, ends.0), (at, ends.1)]),
            ];
            let label = if unit == "1" { name.clone() } else { format!("{name} ({unit})") };
            Panel { x: Axis::linear(label), y: Axis::linear(""), series, ..Panel::default() }
        };
        let title = format!("{}: objective along each parameter, all others as fitted", self.solver);
        Figure { title, columns: 4, panels: (0..self.profiles.len()).map(panel).collect() }
    }
}
