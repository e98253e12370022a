//! `cargo xtask reproduce sweep --set switches --robot ant`: one run's options changed one at a time, every run over several seeds;
//! errors at 10, 100 and 1000 frames of passive motion on the robot's first ground, and the time of a frame on the CPU.
//!
//! A finished run is kept in `out/sweep` and not trained again.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive, summary};
use nerd_train::run::{Run, RunConfig};
use serde::Serialize;

mod entries;
mod report;

use entries::{BASE, Entry, Set, base};

use crate::common::{DEVICES, Device, word};
use crate::numbers::{BATCH, EMBEDDING, LAYERS, SEEDS, STARTS, TRANSITIONS, UPDATES, count};
use nerd_sim::truth::Truth;
use nerd_train::experiments::cost::microseconds;

/// Where runs are kept.
const RUNS: &str = "out/sweep";
/// Frames that errors are given at.
const AT: [usize; 3] = [10, 100, 1000];

/// Change one run's options one at a time.
#[derive(clap::Args, Clone, Debug)]
pub struct SweepArgs {
    /// Which set of runs
    #[arg(long, value_enum)]
    pub set: Set,
    /// Robot: pendulum, cube, ant, anymal
    #[arg(long)]
    pub robot: String,
    /// Runs, comma-separated, beside `base` [default: all of the set]
    #[arg(long, value_delimiter = ',')]
    pub only: Vec<String>,
    /// Seeds of data, weights and windows, comma-separated
    #[arg(long, value_delimiter = ',', default_values_t = [0, 1, 2], value_parser = count::<u64>(SEEDS))]
    pub seed: Vec<u64>,
    /// Updates of each run
    #[arg(long, default_value_t = 1500, value_parser = count::<u64>(UPDATES))]
    pub updates: u64,
    /// Sequences of 32 tokens in an update
    #[arg(long, default_value_t = 32, value_parser = count::<usize>(BATCH))]
    pub batch: usize,
    /// Width of the base's network
    #[arg(long, default_value_t = 48, value_parser = count::<usize>(EMBEDDING))]
    pub embedding: usize,
    /// Its layers
    #[arg(long, default_value_t = 2, value_parser = count::<usize>(LAYERS))]
    pub layers: usize,
    /// Transitions that a run starts with
    #[arg(long, default_value_t = 100_000, value_parser = count::<usize>(TRANSITIONS))]
    pub transitions: usize,
    /// Transitions recorded while it goes on
    #[arg(long, default_value_t = 200_000, value_parser = count::<usize>(0..=*TRANSITIONS.end()))]
    pub fresh: usize,
    /// Trajectories of the evaluation
    #[arg(long, default_value_t = 128, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Where networks are trained and evaluated; a frame is timed on the CPU
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Folder to write
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
}

/// One run of one seed.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    name: &'static str,
    seed: u64,
    parameters: usize,
    minutes: String,
    /// Mean |difference| over trajectories and quantities at 10, 100 and 1000 frames.
    at: [f64; 3],
    /// Mean over the paper's horizon, by quantity.
    error: Vec<f64>,
    diverged: usize,
    /// A frame of one environment on one core.
    microseconds: f64,
}

/// Runs the part.
pub fn run(args: SweepArgs) -> Result<()> {
    let entries = args.set.entries();
    if let Some(name) = args.only.iter().find(|name| entries.iter().all(|e| e.name != **name)) {
        bail!("--only {name}: known are {}", entries.iter().map(|e| e.name).collect::<Vec<_>>().join(", "));
    }
    let asked = |e: &&Entry| args.only.is_empty() || e.name == BASE || args.only.iter().any(|name| name == e.name);
    let entries: Vec<&Entry> = entries.iter().filter(asked).collect();
    let started = Instant::now();
    let mut all = Vec::new();
    for (k, (seed, entry)) in args.seed.iter().flat_map(|seed| entries.iter().map(move |e| (*seed, *e))).enumerate() {
        let total = args.seed.len() * entries.len();
        let left = if k == 0 {
            String::new()
        } else {
            format!(", about {:.0} min left", started.elapsed().as_secs_f64() / k as f64 * (total - k) as f64 / 60.0)
        };
        eprintln!("{}/{total}: {}, {}, seed {seed}{left}", k + 1, args.robot, entry.name);
        all.push(one(&args, entry, seed)?);
    }
    report::write(&args, &all)
}

/// Trains a run unless its model is there, and measures it.
fn one(args: &SweepArgs, entry: &Entry, seed: u64) -> Result<Measured> {
    let mut run = base(&args.robot, args, seed);
    (entry.change)(&mut run);
    let folder = format!(
        "{}-{:?}-e{}l{}-{}x{}-{}+{}",
        args.robot, args.set, args.embedding, args.layers, args.updates, args.batch, args.transitions, args.fresh
    );
    run.out = Path::new(RUNS).join(folder.to_lowercase()).join(entry.name).join(format!("seed{seed}"));
    let model = run.out.join("model");
    if !model.join("config.json").exists() && Run::new(&run)?.train()?.is_none() {
        bail!("training of {} did not finish", run.out.display());
    }
    measure(args, entry, &run, &model)
}

fn measure(args: &SweepArgs, entry: &Entry, run: &RunConfig, folder: &Path) -> Result<Measured> {
    let config = ModelConfig::read(folder)?;
    let system = System::named(&args.robot)?;
    let scene = system.usual_scenes().into_iter().find(|s| *s != "free").unwrap_or("free");
    let scene = system.scene(scene)?;
    let truth = || Truth::Articulated.solver(&system);
    let rolled = |steps: usize, starts: usize| -> Result<_> {
        let protocol = PassiveConfig { starts, steps, seed: 500, action: Action::Zero };
        let mut learned = args.device.neural(folder, &system, None, starts)?;
        Ok(passive(&system, &scene, &mut *truth(), &mut learned, protocol, &mut |_| ())?)
    };
    // What ends in no number at all has no error to speak of.
    let (horizon, far) = (rolled(nerd_train::paper::horizon(&args.robot), args.starts).ok(), rolled(AT[2], args.starts).ok());
    let quantities = system.robot.joint_count() + if system.robot.floating() { 2 } else { 0 };
    let at = AT.map(|frame| far.as_ref().map_or(f64::INFINITY, |r| r.curve[frame - 1]));
    Ok(Measured {
        name: entry.name,
        seed: run.record.seed,
        parameters: config.network.parameters(),
        minutes: config.provenance.get("minutes").cloned().unwrap_or_default(),
        at,
        error: summary(&system, &horizon.map_or_else(|| vec![f64::INFINITY; quantities], |r| r.error)),
        diverged: far.map_or(args.starts, |r| r.diverged),
        microseconds: microseconds(folder, &system, &scene)?,
    })
}
