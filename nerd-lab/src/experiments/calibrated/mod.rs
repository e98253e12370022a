//! Analytic solvers calibrated to measured trajectories, cross-validated over splits by trajectory ([`nerd_sim::calibrate`]).

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

/// Places of a profile, and rollouts behind each.
const PLACES: usize = 9;
const BEHIND: usize = 200;

settings! {
    /// Analytic solvers calibrated to measured trajectories.
    pub struct Calibration {
        /// TOML that describes the measurements; see `nerd_sim::log`. With --own several, comma-separated, each calibrated for itself
        /// [default: nerd-sim/assets/logs/cube.log.toml]
        log: Vec<PathBuf> = vec!["nerd-sim/assets/logs/cube.log.toml".into()], Texts;
        /// Their table, or a folder of tables [default: what the TOML names]
        data: Option<PathBuf> = None, Text;
        /// Name of the result [default: calibrate- and the TOML's first word]
        name: String = String::new(), Text;
        /// Solvers, comma-separated: articulated, fitted by slopes if its robot has them, and rapier, fitted by a search
        solvers: Vec<String> = vec!["articulated".into(), "rapier".into()], Texts;
        /// Substeps of `articulated` (the implicit step)
        substeps: usize = 4, Whole(1..=1024);
        /// Parameters, comma-separated [default: all that free motion may determine]
        parameters: Vec<String> = Vec::new(), Texts;
        /// Parameters that each trajectory has for itself, comma-separated, such as zeros of sensors that were set by hand. They are fitted
        /// together with the others; for a judged trajectory, to its frames --before. Every trajectory is then judged once, by the other
        /// folds: those of the log, or as many as there are --splits; over half as many, as many and twice as many frames as --frames
        own: Vec<String> = Vec::new(), Texts;
        /// With --own: parameters, comma-separated, that a trajectory may have for itself near what all share, or, if they are none of
        /// --parameters, near the robot as described. How near is chosen within the folds that were learned from
        held: Vec<String> = Vec::new(), Texts;
        /// With --own: frames of each trajectory before its first judged rollout
        before: usize = 0, Whole(0..=*FRAMES.end());
        /// Folders of models of the robot, or of a family of its kind, comma-separated. They are judged too, once shown the frames before
        /// each rollout and once shown none. Those that learned from the log are judged on what they held out
        models: Vec<PathBuf> = Vec::new(), Texts;
        /// Random splits by trajectory: fitted to one part, judged on half of the rest (the paper: 400 and 85 of 570)
        splits: usize = 5, Whole(1..=100);
        /// Frames of a rollout
        frames: usize = 80, Whole(2..=*FRAMES.end());
        /// Frames between the starts of rollouts
        every: usize = 4, Whole(FRAMES);
        /// Evaluations of the objective, for each split and solver
        evaluations: usize = 1000, Whole(40..=1_000_000);
        /// Rollouts in an evaluation
        trials: usize = 500, Whole(STARTS);
        /// Seed of splits and search
        seed: u64 = 0, Whole(SEEDS);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibrated {
    pub solver: String,
    /// What it was fitted by: slopes, or a search.
    pub by: String,
    /// Names of its parameters, with bounds around the nominal value, and units.
    pub parameters: Vec<(String, [f64; 3], String)>,
    pub splits: Vec<Split>,
    /// The objective along each parameter of the first split: values, and the objective there.
    pub profiles: Vec<Vec<[f64; 2]>>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CalibratedAll {
    #[serde(flatten)]
    pub settings: Calibration,
    pub robot: String,
    pub notes: Vec<String>,
    /// Trajectories, and rollouts cut from them.
    pub sizes: [usize; 2],
    /// Predicting that nothing moves, on the judged part of every split.
    pub still: Vec<Scored>,
    #[serde(default)]
    pub published: Vec<Published>,
    pub fitted: Vec<Calibrated>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modelled: Vec<Modelled>,
}

impl Calibration {
    fn engine(&self, solver: &str) -> Result<Engine> {
        match solver {
            "articulated" => Ok(Engine::Articulated(ArticulatedConfig::implicit(self.substeps, Friction::Coulomb))),
            "rapier" => Ok(Engine::Rapier(RapierConfig { steps: 1, ..Default::default() })),
            other => bail!("--solvers {other}: choose from articulated, rapier"),
        }
    }

    fn subject(&self, log: &Log, solver: &str) -> Result<(Subject, Vec<Parameter>)> {
        let subject = Subject::new(&log.system, &log.scene, self.engine(solver)?)?;
        let parameters: Vec<Parameter> = match &self.parameters[..] {
            [] => {
                let driven = if log.driven() { Parameter::driven(&log.system)? } else { Vec::new() };
                let all = Parameter::usual(&log.system, &log.scene, solver == "rapier")?.into_iter().chain(driven);
                all.filter(|p| !self.own.contains(&p.name)).collect()
            }
            names => names.iter().map(|name| Parameter::named(&log.system, name)).collect::<std::result::Result<_, _>>()?,
        };
        // Missing capabilities are reported before any search.
        if let Some(reason) = refusal(&mut *subject.engine.solver(), &subject.system, &subject.scene) {
            bail!(reason);
        }
        subject.with(&parameters, &parameters.iter().map(|p| p.nominal).collect::<Vec<_>>())?;
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
            let (evaluations, trials, seed) = (self.evaluations, self.trials, self.seed + k);
            let (config, begun) = (FitConfig { evaluations, trials, seed, slopes: true }, Instant::now());
            let fit = subject.fit(&parameters, &part.train, config, progress)?;
            let (seconds, fitted) = (begun.elapsed().as_secs_f64(), subject.with(&parameters, &fit.values)?);
            Ok((part.split([&subject, &fitted], (&fit, seconds), seed)?, fit))
        };
        // One after the other, so that the clock is each one's own; trials are rolled out on all cores.
        let found = parts.iter().enumerate().map(|(k, part)| one((k as u64, part))).collect::<Result<Vec<_>>>()?;
        let some: Vec<Trial> = thinned(&parts[0].train, BEHIND);
        let own = Fit { before: mean(&subject.distances(&some)?), ..found[0].1.clone() };
        let profiles = subject.profiles(&parameters, &own, &some, PLACES)?;
        let splits: Vec<Split> = found.into_iter().map(|(split, _)| split).collect();
        bar.finish();
        if !splits.iter().all(|s| s.fit.objective.is_finite()) || profiles.iter().flatten().any(|p| !p[1].is_finite()) {
            bail!("{solver}: a rollout ends in no number; the log's numbers are too large, or a parameter's bounds too wide");
        }
        let solver = if solver == "articulated" { format!("articulated implicit x{}", self.substeps) } else { solver.into() };
        let parameters = parameters.iter().map(|p| (p.name.clone(), [p.low, p.nominal, p.high], p.unit.into())).collect();
        let by = if own.slopes { "slopes" } else { "search" }.into();
        Ok(Calibrated { solver, by, parameters, splits, profiles })
    }

    pub fn all(&self) -> Result<CalibratedAll> {
        let [path] = &self.log[..] else { bail!("--log: without --own one log is fitted to, not {}", self.log.len()) };
        let log = Log::read(path, self.data.as_deref())?;
        log.notes.iter().for_each(|note| tell!("{note}"));
        bounds::once("--parameters", &self.parameters)?;
        bounds::once("--solvers", &self.solvers)?;
        self.solvers.iter().try_for_each(|solver| self.engine(solver).map(drop))?;
        let ready = able(&self.solvers, |solver| self.subject(&log, solver).map(|_| solver))?;
        let trials = log.trials(self.frames, self.every);
        let seeds = self.seed..self.seed + self.splits as u64;
        let parts: Vec<Parts> = seeds.clone().map(|seed| Parts::new(&log, &trials, seed)).collect::<Result<_>>()?;
        let still = parts.iter().zip(seeds).map(|(part, seed)| part.still(&log, seed)).collect();
        let fitted = able(&ready, |solver| self.calibrated(&log, solver, &parts))?;
        let modelled = self.modelled(&log, &parts)?;
        let (sizes, robot) = ([log.trajectories.len(), trials.len()], log.system.name.clone());
        Ok(CalibratedAll { settings: self.clone(), robot, notes: log.notes, sizes, still, published: log.published, fitted, modelled })
    }
}

/// What comes of the solvers that can; the others are left out with a line each, if there is one that can.
fn able<'a, T>(solvers: &'a [impl AsRef<str>], of: impl Fn(&'a str) -> Result<T>) -> Result<Vec<T>> {
    let (mut found, mut last) = (Vec::new(), None);
    for solver in solvers.iter().map(AsRef::as_ref) {
        match of(solver) {
            Ok(one) => found.push(one),
            Err(reason) => {
                tell!("{solver}: left out, {reason:#}");
                last = Some(reason);
            }
        }
    }
    match last {
        Some(reason) if found.is_empty() => Err(reason),
        _ => Ok(found),
    }
}

/// The first word of a file's name.
fn stem(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().split('.').next().unwrap_or_default().to_string()).unwrap_or_default()
}

impl Experiment for Calibration {
    fn about(&self) -> Result<About> {
        let Some(first) = self.log.first() else { bail!("--log: name the TOML of a log") };
        let name = if self.name.is_empty() { format!("calibrate-{}", stem(first)) } else { self.name.clone() };
        let (mut inputs, mut files) = (Inputs::default(), Vec::new());
        for log in &self.log {
            let (spec, system) = specified(log)?;
            let table = self.data.clone().unwrap_or_else(|| log.with_file_name(spec.file));
            files.extend([log.clone()].into_iter().chain(tables(&table)?));
            inputs.add(Input::Data { name: system.name.clone(), sha256: system.sha256() });
        }
        inputs.0.insert(0, Input::files(&name, &files)?);
        // Of every robot: what is hashed is how the solver steps.
        for solver in &self.solvers {
            let setting = if solver == "rapier" { Setting::RapierSteps(1) } else { Setting::Implicit(self.substeps) };
            inputs.add(Input::motion("cube", "ground", &setting)?);
        }
        for folder in &self.models {
            inputs.add(Input::model(folder)?);
        }
        let effort = (self.splits * self.solvers.len() * self.evaluations * self.trials) as f64;
        Ok(About { name, seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        if !(self.own.is_empty() && self.held.is_empty() && self.before == 0) {
            if !self.models.is_empty() {
                bail!("--models are judged beside what all trajectories share: leave --own, --held and --before out");
            }
            let found = self.runs()?;
            return Measured::new(&found, found.tables());
        }
        let found = self.all()?;
        let mut measured = Measured::new(&found, vec![found.errors(), found.fits(), found.parameters()])?;
        let first = found.fitted.first().filter(|solver| !solver.profiles.is_empty());
        measured.figures.extend(first.map(|solver| ("figure".into(), solver.figure())));
        Ok(measured)
    }
}

impl Calibrated {
    fn figure(&self) -> Figure {
        let panel = |k: usize| {
            let (profile, (name, _, unit), at) = (&self.profiles[k], &self.parameters[k], self.splits[0].fit.values[k]);
            let points: Vec<(f64, f64)> = profile.iter().map(|p| (p[0], p[1].min(1.5))).collect();
            let ends = points.iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.1), b.max(p.1)));
            let series =
                vec![Series::new("objective", Style::Line, points), Series::new("fit", Style::Dashed, [(at, ends.0), (at, ends.1)])];
            let label = if unit == "1" { name.clone() } else { format!("{name} ({unit})") };
            Panel { x: Axis::linear(label), y: Axis::linear(""), series, ..Panel::default() }
        };
        let title = format!("{}: objective along each parameter, all others as fitted", self.solver);
        Figure { title, columns: 4, panels: (0..self.profiles.len()).map(panel).collect() }
    }
}
