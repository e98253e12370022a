//! `cargo xtask reproduce ablations`: the paper's Figure A.2. NeRD is trained beside itself with one design decision taken back
//! at a time, on the same data for the same number of updates; errors are divided by NeRD's and drawn beside the paper's bars.
//!
//! Test case 1: contact-free passive motion of the double pendulum, 100 frames, mean of both joints; the data has its random
//! grounds. Test case 2: the shipped running policies of the Ant, and how far their rewards in a variant are from those in the
//! truth. Beside it stands passive motion of the Ant on its ground, for 20 frames.
//!
//! A finished variant is kept in `out/ablations` and not trained again. About half an hour on two cores.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;
use nerd_train::run::{Run, RunConfig, Variant};

mod entry;
mod figure;
mod measure;
mod reasons;
mod report;
mod runners;

use entry::{ENTRIES, Entry, NERD};
use measure::{Measured, measure};
use report::Row;
use runners::Runners;

use crate::common::{DEVICES, Device, word};
use crate::numbers::{SEEDS, STARTS, TRANSITIONS, UPDATES, count};

/// Where trained variants are kept.
const RUNS: &str = "out/ablations";

/// Windows in an update of NeRD.
const BATCH: usize = 64;

/// Reproduce the paper's ablations.
#[derive(clap::Args, Clone, Debug)]
pub struct AblationArgs {
    /// Robots, comma-separated: pendulum, ant
    #[arg(long, value_delimiter = ',', default_values_t = ["pendulum".to_string(), "ant".to_string()])]
    pub robot: Vec<String>,
    /// Variants beside NeRD, comma-separated, as their bars are called (`gru`, `abs-pred`, `h-1`) [default: all]
    #[arg(long, value_delimiter = ',')]
    pub only: Vec<String>,
    /// Optimiser updates of each variant, at least 80, since a loss is noted every 20 and its fall is told by quarters
    #[arg(long, default_value_t = 1200, value_parser = count::<u64>(80..=*UPDATES.end()))]
    pub updates: u64,
    /// Transitions of the training data
    #[arg(long, default_value_t = 200_000, value_parser = count::<usize>(TRANSITIONS))]
    pub transitions: usize,
    /// Trajectories of the evaluation (the paper: 2048)
    #[arg(long, default_value_t = 256, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Games of each running policy (the paper: 2048)
    #[arg(long, default_value_t = 128, value_parser = count::<usize>(STARTS))]
    pub games: usize,
    /// Seeds of data, weights and windows, comma-separated; bars are means over them
    #[arg(long, value_delimiter = ',', default_values_t = [0], value_parser = count::<u64>(SEEDS))]
    pub seed: Vec<u64>,
    /// Where Transformers are computed; the other networks are always computed on the CPU
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Folder to write
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
}

/// Runs the part.
pub fn run(args: AblationArgs) -> Result<()> {
    if let Some(robot) = args.robot.iter().find(|r| !["pendulum", "ant"].contains(&r.as_str())) {
        bail!("--robot {robot}: the paper's test cases are of pendulum and ant");
    }
    let (robots, seeds): (HashSet<_>, HashSet<_>) = (args.robot.iter().collect(), args.seed.iter().collect());
    if robots.len() < args.robot.len() || seeds.len() < args.seed.len() {
        bail!("--robot and --seed: each once");
    }
    if let Some(name) = args.only.iter().find(|name| ENTRIES.iter().all(|e| e.folder() != **name)) {
        let names: Vec<String> = ENTRIES.iter().map(Entry::folder).collect();
        bail!("--only {name}: known are {}", names.join(", "));
    }
    let asked = |entry: &&Entry| args.only.is_empty() || entry.name == NERD || args.only.contains(&entry.folder());
    let mut jobs = Vec::new();
    for robot in &args.robot {
        for entry in ENTRIES.iter().filter(asked) {
            jobs.extend(args.seed.iter().map(|seed| (robot.as_str(), entry, *seed)));
        }
    }
    let runners = args.robot.iter().any(|r| r == "ant").then(|| Runners::new(args.games)).transpose()?;
    let mut clock = Clock::new(jobs.iter().map(|(_, entry, _)| entry.cost()).sum());
    let mut rows: Vec<Row> = Vec::new();
    for (k, (robot, entry, seed)) in jobs.iter().enumerate() {
        eprintln!("{}/{}: {robot}, {}, seed {seed}{}", k + 1, jobs.len(), entry.name, clock.left());
        let system = System::named(robot)?;
        let (config, trained) = trained(robot, entry, *seed, &args)?;
        let device = device(entry, args.device);
        let measured = measure(&folder(robot, entry, *seed, &args)?, &system, (args.starts, *seed), runners.as_ref(), device)?;
        clock.done(entry.cost(), trained);
        match rows.iter_mut().find(|r| r.robot == *robot && r.name == entry.name) {
            Some(row) => row.add(&config, measured)?,
            None => rows.push(Row::new(robot, entry, &config, measured)),
        }
    }
    report::check(&rows)?;
    report::write(&args, &rows, runners.as_ref().map_or(0, Runners::len))?;
    figure::draw(&rows, &args.robot, &args.out.join("ablations"))?;
    eprintln!("written to {}", args.out.display());
    Ok(())
}

/// How NeRD is trained; everything that decides a run's bytes stands in its folder's name.
fn nerd(robot: &str, seed: u64, args: &AblationArgs) -> Result<RunConfig> {
    let out = Path::new(RUNS).join(format!("{robot}-updates{}-transitions{}-seed{seed}", args.updates, args.transitions));
    let mut run = RunConfig::recipe("quick", robot, out)?;
    (run.updates, run.transitions, run.batch, run.device) = (args.updates, args.transitions, BATCH, args.device);
    // The end of the run alone is looked at: the last weights, whose rate fell to zero, or their average.
    (run.validate_every, run.rollouts, run.record.seed) = (Some(args.updates), 32, seed);
    Ok(run)
}

/// Folder of a variant's run.
fn folder(robot: &str, entry: &Entry, seed: u64, args: &AblationArgs) -> Result<PathBuf> {
    Ok(entry.train(&nerd(robot, seed, args)?).out)
}

fn device(entry: &Entry, asked: Device) -> Device {
    use Variant::{Gru, Lstm, Mlp};
    if matches!(entry.variant, Mlp | Gru | Lstm) { Device::Cpu } else { asked }
}

/// Trains a variant unless its model is there; what its folder says of it, and whether it was trained now.
fn trained(robot: &str, entry: &Entry, seed: u64, args: &AblationArgs) -> Result<(ModelConfig, bool)> {
    let path = folder(robot, entry, seed, args)?.join("model/config.json");
    let fresh = !path.exists();
    if fresh {
        let mut run = entry.train(&nerd(robot, seed, args)?);
        run.device = device(entry, args.device);
        if Run::new(&run)?.train()?.is_none() {
            bail!("training of {} did not finish", run.out.display());
        }
    }
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    Ok((serde_json::from_str(&text).with_context(|| path.display().to_string())?, fresh))
}

/// Time left of a job whose parts cost what their updates cost.
struct Clock {
    started: Instant,
    left: f64,
    paid: f64,
}

impl Clock {
    fn new(left: f64) -> Self {
        Self { started: Instant::now(), left, paid: 0.0 }
    }

    /// A part is done; one that was there already says nothing about speed.
    fn done(&mut self, cost: f64, trained: bool) {
        self.left -= cost;
        if trained {
            self.paid += cost;
        } else if self.paid == 0.0 {
            self.started = Instant::now();
        }
    }

    fn left(&self) -> String {
        if self.paid == 0.0 {
            return String::new();
        }
        format!(", about {:.0} min left", (self.started.elapsed().as_secs_f64() / self.paid * self.left / 60.0).max(0.0))
    }
}
