//! `cargo xtask chart --robot pendulum --scene ground1`: every solver of a scene on one picture.
//!
//! x: microseconds a frame of one environment takes on one core. y: mean |difference| of q over the horizon from a
//! converged reference, passive motion from the robot's reset law. Time and error come from the same steps, so a broken
//! simulation cannot be fast. The reference's own error (its distance from half its substeps) is a dashed line, as are
//! the two floors that know no dynamics. A model that learned from another engine is held against that engine, as its name
//! says, since it cannot be nearer to the reference than what it learned. `--mujoco` asks another engine in, see [`crate::mujoco`].

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use nerd_model::folder::ModelConfig;
use nerd_model::pick::Setting;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport, passive, summary};
use serde::{Deserialize, Serialize};

use crate::common::{Device, bar};
use crate::mujoco::series::{self, Against};
use crate::numbers::{self, FRAMES, SEEDS, STARTS, SUBSTEPS, count};
use crate::plot::{Figure, Series};
use crate::provenance::Provenance;
use crate::solvers::{describe, neural};
use crate::table::{digits, markdown, pair};
use crate::truth::Truth;

/// Draw speed against accuracy.
#[derive(clap::Args, Clone, Debug)]
pub struct ChartArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, anymal-paper, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// Scene: free, a scene of the robot (ground, or ground1 .. ground6 for the pendulum), plane, slope, box, steps, hills
    #[arg(long, default_value = "free")]
    pub scene: String,
    /// Model folders, comma-separated [default: models/ROBOT and models/ROBOT-rapier, if they are there]
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Trajectories
    #[arg(long, default_value_t = 64, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Frames over which the error is the mean [default: 100]
    #[arg(long, default_value_t = 100, value_parser = count::<usize>(FRAMES))]
    pub horizon: usize,
    /// Largest number of substeps
    #[arg(long, default_value_t = 256, value_parser = count::<usize>(SUBSTEPS))]
    pub substeps: usize,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Python that has MuJoCo, to draw that engine too [default if no value is given: python3]
    #[arg(long, value_name = "PYTHON", num_args = 0..=1, default_missing_value = "python3")]
    pub mujoco: Option<PathBuf>,
    /// Folder for chart-ROBOT-SCENE.svg, .png and .json
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
}

impl ChartArgs {
    /// A chart as the README shows it.
    pub fn new(robot: &str, scene: &str) -> Self {
        let (robot, scene) = (robot.into(), scene.into());
        let (model, mujoco, out) = (Vec::new(), None, "results".into());
        Self { robot, scene, model, starts: 64, horizon: 100, substeps: 256, seed: 500, mujoco, out }
    }
}

/// One mark on the chart.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Point {
    /// Name in the legend.
    pub series: String,
    /// The solver, for [`nerd_model::pick`]; none of another engine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setting: Option<Setting>,
    /// Substeps a frame.
    pub substeps: Option<usize>,
    /// Frame of one environment on one core: the fastest of a few runs.
    pub microseconds: f64,
    /// Mean over coordinates.
    pub error: f64,
    /// Mean |difference| of each.
    pub by_coordinate: Vec<f64>,
    /// Rollouts that left.
    pub diverged: usize,
    /// Whether no other point beats it in both.
    pub front: bool,
    /// Whether its error is against a reference of its own, so that it competes with no other series.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub own: bool,
}

/// What is drawn, and what it was held against.
struct Measured {
    points: Vec<Point>,
    /// The reference's report: its error is that of half its substeps.
    base: PassiveReport,
    reference: String,
    mujoco: Option<Against>,
}

/// Runs the verb.
pub fn run(args: ChartArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    let scene = system.scene(&args.scene)?;
    let frames = [("--starts", args.starts), ("--horizon", args.horizon)];
    // Every state of the reference is kept, and of a model's own truth.
    numbers::memory(&frames, 16 * system.robot.state_dim())?;
    // The reference has four times the substeps.
    numbers::time(&[frames[0], frames[1], ("4 x --substeps", 4 * args.substeps)])?;
    let mut models = args.model.clone();
    if models.is_empty() {
        let shipped = Truth::ALL.iter().map(|t| nerd_train::shipped::model(*t, &system.name));
        models.extend(shipped.filter(|folder| folder.join("config.json").exists()));
    }
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().context("cannot start a thread")?;
    let Measured { points, base, reference, mujoco } = one.install(|| measure(&args, &system, &scene, models))?;
    let rows = points.iter().map(|p| {
        let setting = p.substeps.map_or_else(|| "-".into(), |n| n.to_string());
        vec![
            p.series.clone(),
            setting,
            digits(p.microseconds),
            pair(&summary(&system, &p.by_coordinate)),
            p.diverged.to_string(),
            if p.front { "*" } else { "" }.into(),
        ]
    });
    let header = ["solver", "substeps", "us a frame", "error (rad or m)", "diverged", "front"];
    println!("{} {}, mean |dq| over {} frames, reference: {reference}\n", system.name, scene.name, args.horizon);
    println!("{}", markdown(&header, &rows.collect::<Vec<_>>()));
    if let Some(Against { version, reference, reference_error }) = &mujoco {
        let error = reference_error.map_or_else(String::new, |e| format!(", whose own error is {}", digits(e)));
        println!("MuJoCo {version} is held against {reference}{error}");
    }
    let stem = args.out.join(format!("chart-{}-{}", system.name, scene.name));
    let mut json = serde_json::json!({
        "provenance": Provenance::now(args.seed),
        "robot": system.name,
        "scene": scene.name,
        "protocol": PassiveConfig { starts: args.starts, steps: args.horizon, seed: args.seed, action: Action::Limp },
        "reference": reference,
        "reference_error": mean(&base.error),
        "hold": mean(&base.hold),
        "glide": mean(&base.glide),
        "points": points,
    });
    if let Some(mujoco) = mujoco {
        json["mujoco"] = serde_json::to_value(mujoco)?;
    }
    crate::files::write(&stem.with_extension("json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    Ok(figure(&args, &system, &points, &base).save(&stem)?)
}

/// Every method timed and held against the reference.
fn measure(args: &ChartArgs, system: &Arc<System>, scene: &Arc<Scene>, models: Vec<PathBuf>) -> Result<Measured> {
    let contact = !scene.colliders.is_empty();
    let powers = || std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n <= args.substeps);
    let mut methods: Vec<Setting> = powers().map(Setting::Euler).collect();
    if contact {
        methods.extend(powers().take_while(|n| 2 * n <= args.substeps).map(Setting::Implicit));
        methods.extend(powers().take_while(|n| 4 * n <= args.substeps).map(Setting::RapierSteps));
    } else {
        methods.extend(powers().take_while(|n| *n <= 32).map(Setting::Rk4));
    }
    methods.extend(powers().map(Setting::Rapier));
    methods.push(Setting::Paper);
    methods.extend(models.into_iter().map(Setting::Neural));

    let (finest, reference) = if contact { (4 * args.substeps, "articulated, implicit") } else { (128, "articulated, RK4") };
    let exact = |n: usize| if contact { Setting::Implicit(n) } else { Setting::Rk4(n) };
    let config = PassiveConfig { starts: args.starts, steps: args.horizon, seed: args.seed, action: Action::Limp };
    // Begun first, for it may not be there.
    let mut referee = args.mujoco.as_ref().map(|python| series::referee(python, system, scene, config)).transpose()?;
    let built = methods.into_iter().map(|m| Ok((own(&m)?, legend(&m)?, m.solver(system)?, m))).collect::<Result<Vec<_>>>()?;
    let bar = bar("solvers", built.len() as u64 + 1);
    let mut truth = Recorder { solver: exact(finest).solver(system)?, frames: Vec::new() };
    let base = passive(system, scene, &mut truth, &mut *exact(finest / 2).solver(system)?, config, &mut |_| ())?;
    numbers::figures(&format!("{reference}: its mean error"), &[&base.error, &base.hold, &base.glide].map(|x| mean(x)))?;
    let mut points = Vec::new();
    for (k, (own, series, solver, setting)) in built.into_iter().enumerate() {
        let substeps = setting.substeps();
        bar.set(k as u64 + 1);
        let record = |own: Truth| -> Result<Vec<Vec<f64>>> {
            let mut theirs = Recorder { solver: own.solver(system), frames: Vec::new() };
            let mut idle = Replay { frames: &truth.frames, next: 0 };
            passive(system, scene, &mut theirs, &mut idle, config, &mut |_| ())?;
            Ok(theirs.frames)
        };
        let theirs = own.map(record).transpose()?;
        let frames = theirs.as_ref().unwrap_or(&truth.frames);
        let mut timed = Timed { solver, spent: Duration::ZERO };
        let (mut runs, mut total, mut best, mut report) = (0, Duration::ZERO, Duration::MAX, None);
        while runs == 0 || (total < Duration::from_millis(300) && runs < 20) || (runs < 3 && total < Duration::from_secs(10)) {
            timed.spent = Duration::ZERO;
            let mut replay = Replay { frames, next: 0 };
            match passive(system, scene, &mut replay, &mut timed, config, &mut |_| ()) {
                Ok(found) => report = Some(found),
                Err(error) => {
                    eprintln!("{series} {substeps:?}: left out, {error}");
                    break;
                }
            }
            (runs, total, best) = (runs + 1, total + timed.spent, best.min(timed.spent));
        }
        let Some(report) = report else { continue };
        numbers::figures(&format!("{series} {substeps:?}: its mean error"), &[mean(&report.error)])?;
        points.push(Point {
            series,
            substeps,
            setting: Some(setting),
            microseconds: best.as_secs_f64() * 1e6 / (args.starts * args.horizon) as f64,
            error: mean(&report.error),
            by_coordinate: report.error,
            diverged: report.diverged,
            front: false,
            own: own.is_some(),
        });
    }
    bar.finish();
    let reference = format!("{reference}, {finest} substeps");
    let mut mujoco = None;
    if let Some(referee) = &mut referee {
        let (theirs, against) = series::points(referee, system, scene, config, args.substeps, (&truth.frames, &reference))?;
        points.extend(theirs);
        mujoco = Some(against);
    }
    for i in 0..points.len() {
        let Point { microseconds: t, error: e, own, .. } = points[i];
        let beaten = |p: &Point| !p.own && p.microseconds <= t && p.error <= e && (p.microseconds < t || p.error < e);
        points[i].front = !own && !points.iter().any(beaten);
    }
    Ok(Measured { points, base, reference, mujoco })
}

fn figure(args: &ChartArgs, system: &System, points: &[Point], base: &PassiveReport) -> Figure {
    let mut series: Vec<Series> = Vec::new();
    // What knows less than one who repeats the start stands in the table; in the picture it would flatten all the others.
    for p in points.iter().filter(|p| p.error < 2.0 * mean(&base.hold)) {
        let mark = (p.microseconds, p.error, p.substeps.map_or_else(String::new, |n| n.to_string()));
        match series.last_mut().filter(|s| s.name == p.series) {
            Some(s) => s.points.push(mark),
            None => series.push(Series { name: p.series.clone(), points: vec![mark] }),
        }
    }
    let mut front: Vec<(f64, f64)> =
        points.iter().filter(|p| p.front && p.error < 2.0 * mean(&base.hold)).map(|p| (p.microseconds, p.error)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    // A reference far below every solver would only stretch the picture.
    let least = points.iter().map(|p| p.error).fold(f64::MAX, f64::min);
    let mut levels = vec![(mean(&base.hold), "hold last".to_string())];
    if mean(&base.error) > 0.1 * least {
        levels.push((mean(&base.error), "error of the reference".into()));
    }
    Figure {
        title: format!("{}, {}: speed against accuracy", system.name, args.scene),
        x: "microseconds a frame, one environment, one core".into(),
        y: format!("mean |dq| over {} frames (rad or m)", args.horizon),
        series,
        front,
        levels,
    }
}

/// What a setting is held against, if that is not the chart's reference.
fn own(setting: &Setting) -> Result<Option<Truth>> {
    Ok(match setting {
        Setting::Neural(folder) => Some(ModelConfig::truth_of(folder)?).filter(|truth| *truth != Truth::Articulated),
        _ => None,
    })
}

/// Name in the legend.
fn legend(setting: &Setting) -> Result<String> {
    Ok(match setting {
        Setting::Rk4(_) => "articulated RK4".into(),
        Setting::Euler(_) => "articulated symplectic Euler".into(),
        Setting::Implicit(_) => "articulated implicit".into(),
        Setting::Paper => "articulated, preset paper (NeRD's truth)".into(),
        Setting::Rapier(_) => "rapier, iterations of 1 step".into(),
        Setting::RapierSteps(_) => "rapier, steps of 4 iterations".into(),
        Setting::Neural(folder) => {
            let name = describe(&ModelConfig::read(folder)?);
            own(setting)?.map_or(name.clone(), |truth| format!("{name}, against {}", truth.name()))
        }
    })
}

/// The mean.
pub fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// Microseconds that a model takes for a frame of one environment on one core of the CPU, best of five.
pub fn microseconds(folder: &Path, system: &Arc<System>, scene: &Arc<Scene>) -> Result<f64> {
    const ENVIRONMENTS: usize = 256;
    const FRAMES: usize = 40;
    const REPEATS: usize = 5;
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().context("cannot start a thread")?;
    one.install(|| {
        let truth = ModelConfig::truth_of(folder)?;
        let protocol = PassiveConfig { starts: ENVIRONMENTS, steps: FRAMES, seed: 501, action: Action::Zero };
        let mut best = f64::INFINITY;
        for _ in 0..REPEATS {
            let mut learned = Timed { solver: Box::new(neural(folder, system, None, Device::Cpu, ENVIRONMENTS)?), spent: Duration::ZERO };
            passive(system, scene, &mut *truth.solver(system), &mut learned, protocol, &mut |_| ())?;
            best = best.min(learned.spent.as_secs_f64() * 1e6 / (ENVIRONMENTS * FRAMES) as f64);
        }
        Ok(best)
    })
}

/// Adds up the time its solver takes.
pub struct Timed {
    /// The solver.
    pub solver: Box<dyn Solver>,
    /// Time it has taken.
    pub spent: Duration,
}

impl Solver for Timed {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let start = Instant::now();
        let done = self.solver.step(batch, torques);
        self.spent += start.elapsed();
        done
    }

    fn reset(&mut self, env: usize) {
        self.solver.reset(env);
    }
}

/// Keeps every state its solver comes to.
pub struct Recorder {
    /// The solver.
    pub solver: Box<dyn Solver>,
    /// States by frame.
    pub frames: Vec<Vec<f64>>,
}

impl Solver for Recorder {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.solver.step(batch, torques)?;
        self.frames.push(batch.states.clone());
        Ok(())
    }
}

/// Plays recorded states back.
pub struct Replay<'a> {
    /// States by frame.
    pub frames: &'a [Vec<f64>],
    /// The frame to come.
    pub next: usize,
}

impl Solver for Replay<'_> {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        batch.states.copy_from_slice(&self.frames[self.next]);
        self.next += 1;
        Ok(())
    }
}
