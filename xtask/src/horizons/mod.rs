//! `cargo xtask reproduce horizons`: how the error of each shipped model grows over 1000 frames, as percentiles over rollouts, beside
//! the floor that repeats the start; and one rollout of it over the truth's. Into `results/horizons.json`, `.md` and a picture a robot.

use std::path::{Path, PathBuf};

use anyhow::Result;
use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use nerd_train::evaluate::{Action, PassiveConfig, differences, summary, watched};
use serde::Serialize;

mod figure;

use crate::common::{DEVICES, Device, word};
use crate::numbers::{self, FRAMES, SEEDS, STARTS, count};
use crate::provenance::Provenance;
use crate::solvers::{describe, neural};
use crate::table::{digits, markdown};

/// Draw error against time of learned models.
#[derive(clap::Args, Clone, Debug)]
pub struct HorizonArgs {
    /// Folders of models, comma-separated
    #[arg(long, value_delimiter = ',', default_values_t = ["models/cartpole", "models/pendulum", "models/cube", "models/ant", "models/anymal"].map(String::from))]
    pub model: Vec<String>,
    /// Rollouts
    #[arg(long, default_value_t = 128, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Frames
    #[arg(long, default_value_t = 1000, value_parser = count::<usize>(FRAMES))]
    pub steps: usize,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Where networks are computed
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Folder to write
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
}

/// One model's errors by frame.
#[derive(Serialize)]
pub struct Horizon {
    robot: String,
    method: String,
    model: String,
    truth: String,
    scene: String,
    starts: usize,
    diverged: usize,
    /// Frames that the bands are given at.
    frames: Vec<usize>,
    /// Position (m), orientation (rad), joints (rad or m); the mean of the joints if there are more than two.
    quantities: Vec<Quantity>,
    /// Coordinates of the first start, truth and prediction by frame.
    #[serde(skip)]
    paths: Vec<(String, [Vec<f64>; 2])>,
    #[serde(skip)]
    frame_time: f64,
}

/// Errors of one quantity.
#[derive(Serialize)]
struct Quantity {
    name: String,
    /// 10th, 50th and 90th percentile over rollouts, by frame.
    bands: Vec<[f64; 3]>,
    /// Median of the predictor that repeats the start.
    hold: Vec<f64>,
}

/// Frames in the table.
const SHOWN: [usize; 3] = [10, 100, 1000];

/// Runs the part.
pub fn run(args: HorizonArgs) -> Result<()> {
    let mut all = Vec::new();
    for model in &args.model {
        let horizon = measure(Path::new(model), &args)?;
        let name = Path::new(model).file_name().map_or_else(|| horizon.robot.clone(), |n| n.to_string_lossy().into_owned());
        figure::draw(&horizon, &args.out.join(format!("horizon-{name}")))?;
        all.push(horizon);
    }
    let table = table(&all);
    println!("\nPassive motion, median error [10th to 90th percentile] after so many frames:\n\n{table}");
    let stamp = Provenance::now(args.seed);
    let from = format!("\n`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
    crate::files::write(&args.out.join("horizons.md"), (table + &from).as_bytes())?;
    let json = serde_json::json!({ "provenance": stamp, "rows": all });
    crate::files::write(&args.out.join("horizons.json"), (serde_json::to_string(&json)? + "\n").as_bytes())
}

/// Rolls one model out on its robot's first scene that it is asked on.
fn measure(folder: &Path, args: &HorizonArgs) -> Result<Horizon> {
    let config = ModelConfig::read(folder)?;
    let system = System::named(&config.robot)?;
    // Of every frame the errors of every start are kept, and the floor's.
    let frames = [("--starts", args.starts), ("--steps", args.steps)];
    numbers::memory(&frames, 64 + 16 * (2 + system.robot.joint_count()))?;
    numbers::time(&[frames[0], frames[1], ("substeps", system.spec.substeps)])?;
    // Flight has no error where there is nothing to touch.
    let scenes = system.usual_scenes();
    let name = scenes.iter().find(|s| !config.base.flies() || **s != "free").copied().unwrap_or("free");
    let (scene, truth) = (system.scene(name)?, ModelConfig::truth_of(folder)?);
    let mut learned = neural(folder, &system, None, args.device, args.starts)?;
    let protocol = PassiveConfig { starts: args.starts, steps: args.steps, seed: args.seed, action: Action::Zero };
    let bar = crate::common::bar(&format!("frames of {}", folder.display()), args.steps as u64);
    let starts: Vec<_> = (0..args.starts as u64).map(|env| start(&system, Start::Reset, &mut stream(args.seed, env))).collect();
    let (mut errors, mut holds, mut paths) = (Vec::new(), Vec::new(), figure::paths(&system));
    let report = watched(&system, &scene, [&mut *truth.solver(&system), &mut learned], protocol, &mut |step, real, learned| {
        bar.set(step as u64);
        let row = |env: usize, other: &[f64]| summary(&system, &differences(&system, real.state(env), other));
        errors.push((0..args.starts).map(|env| row(env, learned.state(env))).collect::<Vec<_>>());
        holds.push(starts.iter().enumerate().map(|(env, start)| row(env, start)).collect::<Vec<_>>());
        for (_, index, _, both) in &mut paths {
            both.iter_mut().zip([real, learned]).for_each(|(path, batch)| path.push(batch.state(0)[*index]));
        }
    })?;
    bar.finish();
    numbers::figures(&format!("{}: error", folder.display()), &report.error)?;
    let frames: Vec<usize> = (0..=60).map(|k| (args.steps as f64).powf(k as f64 / 60.0).round() as usize).collect();
    let frames: Vec<usize> =
        frames.into_iter().chain(SHOWN).filter(|f| *f <= args.steps).collect::<std::collections::BTreeSet<_>>().into_iter().collect();
    let width = errors.first().and_then(|e| e.first()).map_or(0, Vec::len);
    let column = |rows: &Vec<Vec<f64>>, k: usize| rows.iter().map(|r| r[k]).collect::<Vec<_>>();
    let quantities = (0..width).map(|k| Quantity {
        name: figure::name(&system, k),
        bands: frames.iter().map(|f| [0.1, 0.5, 0.9].map(|p| percentile(column(&errors[f - 1], k), p))).collect(),
        hold: frames.iter().map(|f| percentile(column(&holds[f - 1], k), 0.5)).collect(),
    });
    Ok(Horizon {
        method: describe(&config),
        model: folder.display().to_string(),
        truth: truth.name(),
        scene: name.into(),
        starts: args.starts,
        diverged: report.diverged,
        quantities: quantities.collect(),
        frames,
        paths: paths.into_iter().map(|(name, _, wraps, both)| (name, both.map(|p| if wraps { unwrapped(p) } else { p }))).collect(),
        frame_time: system.frame_time,
        robot: config.robot,
    })
}

/// The value below which a share of them lies.
fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

/// An angle without its jumps.
fn unwrapped(mut path: Vec<f64>) -> Vec<f64> {
    for k in 1..path.len() {
        path[k] = path[k - 1] + nerd_core::state::wrap(path[k] - path[k - 1]);
    }
    path
}

fn table(all: &[Horizon]) -> String {
    let mut rows = Vec::new();
    for h in all {
        for q in &h.quantities {
            let at = |frame: usize| h.frames.iter().position(|f| *f == frame);
            let cell = |frame: usize| {
                at(frame).map_or_else(
                    || "-".into(),
                    |k| {
                        let [low, middle, high] = q.bands[k].map(digits);
                        format!("{middle} [{low} to {high}]")
                    },
                )
            };
            let hold = h.frames.len().checked_sub(1).map_or_else(String::new, |k| digits(q.hold[k]));
            let mut row = vec![h.robot.clone(), h.scene.clone(), q.name.clone()];
            row.extend(SHOWN.map(cell));
            row.extend([hold, format!("{} of {}", h.diverged, h.starts)]);
            rows.push(row);
        }
    }
    let shown = SHOWN.map(|f| format!("{f} frames"));
    markdown(&["robot", "scene", "error", &shown[0], &shown[1], &shown[2], "hold last, at the end", "diverged"], &rows)
}
