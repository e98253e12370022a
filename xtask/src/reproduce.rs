//! `cargo xtask reproduce`: the main job. Rolls the shipped models out against the truths they learned (Cartpole 1000
//! frames, double pendulum 100 frames on its seven grounds), prints the table beside the paper's, draws speed against
//! accuracy, writes `results/`. Minutes on two cores. `--train` first trains small models from nothing on the CPU.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use nerd_model::folder::ModelConfig;

use crate::ablations::{self, AblationArgs};
use crate::chart::{self, ChartArgs};
use crate::common::{DEVICES, Device, word};
use crate::evaluate::{self, EvaluateArgs};
use crate::horizons::{self, HorizonArgs};
use crate::numbers::{SEEDS, STARTS, count};
use crate::policy::reproduce::{PoliciesArgs, run as policies};
use crate::policy::transfer::{self, TransferArgs};
use crate::provenance::Provenance;
use crate::solvers::{SolverArgs, SolverName};
use crate::sweep::{self, SweepArgs};
use crate::train::{self, TrainArgs};
use crate::truth::Truth;

/// Robots, the names of their models in `models/`, the first of them the default, and the scenes whose charts are drawn.
const MODELS: [(&str, &[&str], &[&str]); 5] = [
    ("cartpole", &["cartpole"], &["free"]),
    ("pendulum", &["pendulum", "pendulum-small", "pendulum-paper", "pendulum-rapier"], &["free", "ground1"]),
    ("cube", &["cube", "cube-rapier"], &[]),
    ("ant", &["ant", "ant-rapier"], &[]),
    ("anymal", &["anymal"], &[]),
];

/// Those whose data and network are a matter of minutes on a CPU.
const QUICK: [&str; 2] = ["cartpole", "pendulum"];

/// Where models trained here and now, and what is said of them, go.
const OWN: &str = "out/reproduce";

/// Reproduce the tables and charts of the README.
#[derive(clap::Args, Clone, Debug)]
#[command(args_conflicts_with_subcommands = true)]
pub struct ReproduceArgs {
    #[command(subcommand)]
    pub part: Option<Part>,
    /// Train small models from nothing instead of taking the shipped ones
    #[arg(long)]
    pub train: bool,
    /// Trajectories by scene (the paper: 2048)
    #[arg(long, default_value_t = 256, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Leave the charts out
    #[arg(long)]
    pub tables_only: bool,
    /// Where the networks of the table are computed; those of the charts are on one CPU core
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder to write [default: results, with --train out/reproduce]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// What is reproduced by itself.
#[derive(clap::Subcommand, Clone, Debug)]
pub enum Part {
    /// The paper's Figure A.2: NeRD against itself with one design decision taken back
    Ablations(AblationArgs),
    /// Error against time of the shipped models, over 1000 frames
    Horizons(HorizonArgs),
    /// One run's options changed one at a time, over several seeds
    Sweep(SweepArgs),
    /// The shipped policies in the truth and in the simulator that learned it
    Policies(PoliciesArgs),
    /// Policies' gaps by the size of the network they were trained in
    Transfer(TransferArgs),
}

/// Runs the verb.
pub fn run(args: ReproduceArgs) -> Result<()> {
    match args.part {
        Some(Part::Ablations(args)) => return ablations::run(args),
        Some(Part::Horizons(args)) => return horizons::run(args),
        Some(Part::Sweep(args)) => return sweep::run(args),
        Some(Part::Policies(args)) => return policies(args),
        Some(Part::Transfer(args)) => return transfer::run(args),
        None => {}
    }
    let out = args.out.clone().unwrap_or_else(|| if args.train { OWN.into() } else { "results".into() });
    let mut rows = Vec::new();
    let mut charts: Vec<(&str, Vec<PathBuf>, &[&str])> = Vec::new();
    for (robot, names, scenes) in MODELS.into_iter().filter(|m| !args.train || QUICK.contains(&m.0)) {
        let models: Vec<PathBuf> =
            if args.train { vec![trained(robot, &args)?] } else { names.iter().map(|name| Path::new("models").join(name)).collect() };
        for model in &models {
            // rapier as a truth costs a hundred times what ours does.
            let starts = if ModelConfig::truth_of(model)? == Truth::default() { args.starts } else { args.starts.div_ceil(4) };
            rows.extend(evaluate::rows(&EvaluateArgs {
                robot: robot.to_string(),
                scene: Vec::new(),
                solver: SolverArgs {
                    solver: Some(SolverName::Neural),
                    model: Some(model.clone()),
                    device: Some(args.device),
                    ..SolverArgs::default()
                },
                starts,
                steps: None,
                seed: args.seed,
                drive: 0.0,
                limp: false,
                shake: 0.0,
                control: false,
                out: None,
            })?);
        }
        charts.push((robot, models, scenes));
    }
    let table = evaluate::table(&rows);
    println!("\nNeRD against its truth (`{}` where none is named), mean |dq| by joint:\n\n{table}", Truth::default().name());
    evaluate::write(&out.join("passive.json"), &rows, args.seed)?;
    let stamp = Provenance::now(args.seed);
    let from = format!("\n`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
    crate::files::write(&out.join("passive.md"), (table + &from).as_bytes())?;
    if !args.tables_only {
        for (robot, models, scenes) in charts {
            for scene in scenes {
                chart::run(ChartArgs { model: models.clone(), seed: args.seed, out: out.clone(), ..ChartArgs::new(robot, scene) })?;
            }
        }
    }
    eprintln!("written to {}", out.display());
    Ok(())
}

/// A small model trained here and now, unless an earlier call has; its folder.
fn trained(robot: &str, args: &ReproduceArgs) -> Result<PathBuf> {
    let out = Path::new(OWN).join(robot);
    eprintln!("training a small model of {robot} in {}", out.display());
    match train::train(&TrainArgs::small(robot, out, args.device))? {
        Some(folder) => Ok(folder),
        None => bail!("training of {robot} did not finish"),
    }
}
