//! `cargo xtask reproduce transfer`: how a policy's gap depends on the size of the network it was trained in, and so the cheapest
//! network whose policies transfer. Into `results/transfer.md`, `.json` and a picture.
//!
//! Each model of the Ant plays the running policies trained in `models/ant` (guests) and, if its folder has a `policy`, the one
//! trained in itself (own); both are played in the truth, too.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use nerd_model::folder::ModelConfig;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive, summary};
use nerd_train::ppo::{Policy, folder};
use serde::Serialize;

use super::arena::Arena;
use super::evaluate::{Reward, gap, reward};
use crate::chart::microseconds;
use crate::common::{DEVICES, Device, folders, word};
use crate::plot::{Figure, Series};
use crate::provenance::Provenance;
use crate::solvers::{SolverName, neural};
use crate::table::{digits, markdown, pair};
use crate::truth::Truth;

const TASK: &str = "ant-run";
/// The model that guests were trained in.
const HOME: &str = "models/ant";
/// A model's policies transfer if their mean reward in it is at most so far (%) from that in the truth.
const TRANSFERS: f64 = 1.0;

/// Draw policies' gaps against the size of the network.
#[derive(clap::Args, Clone, Debug)]
pub struct TransferArgs {
    /// Folders of models, comma-separated [default: models/sizes/ant-*, models/ant]
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Games of each policy (the paper: 2048)
    #[arg(long, default_value_t = 512)]
    pub games: usize,
    /// Trajectories of passive motion
    #[arg(long, default_value_t = 128)]
    pub starts: usize,
    /// Where networks are computed; a frame is timed on the CPU
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of the starts
    #[arg(long, default_value_t = 500)]
    pub seed: u64,
    /// Folder to write
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
}

/// One policy in one model.
#[derive(Clone, Debug, Serialize)]
struct Played {
    policy: PathBuf,
    real: Reward,
    learned: Reward,
}

/// One model.
#[derive(Clone, Debug, Serialize)]
struct Row {
    model: PathBuf,
    parameters: usize,
    /// A frame of one environment on one core.
    microseconds: f64,
    /// Passive motion over the paper's horizon.
    error: Vec<f64>,
    own: Vec<Played>,
    guests: Vec<Played>,
}

/// Gap of the mean over policies, as the paper's over seeds.
fn together(all: &[Played]) -> Option<f64> {
    let (real, learned) = all.iter().fold((0.0, 0.0), |(real, learned), p| (real + p.real.mean, learned + p.learned.mean));
    (!all.is_empty()).then(|| gap(real, learned))
}

/// Runs the part.
pub fn run(args: TransferArgs) -> Result<()> {
    if args.games == 0 || args.starts == 0 {
        bail!("--games, --starts: at least one is needed");
    }
    let mut models = args.model.clone();
    if models.is_empty() {
        models = folders(Path::new("models/sizes"), "ant-")?;
        models.push(HOME.into());
    }
    let truth = Arena { solver: SolverName::Articulated, model: None, device: args.device };
    let real = |path: PathBuf| -> Result<(PathBuf, Policy, Reward)> {
        let (config, policy) = folder::load(&path)?;
        if config.task != TASK {
            bail!("{} is a policy of `{}`, not of `{TASK}`", path.display(), config.task);
        }
        let real = reward(TASK, &truth, &policy, args.games, args.seed)?;
        Ok((path, policy, real))
    };
    let guests = folders(Path::new("models/policies"), &format!("{TASK}-neural-"))?;
    let guests = guests.into_iter().map(real).collect::<Result<Vec<_>>>()?;
    let system = System::named("ant")?;
    let scene = system.scene("ground")?;
    let mut rows = Vec::new();
    for model in models {
        let arena = Arena { solver: SolverName::Neural, model: Some(model.clone()), device: args.device };
        let play = |(path, policy, real): &(PathBuf, Policy, Reward)| -> Result<Played> {
            Ok(Played { policy: path.clone(), real: *real, learned: reward(TASK, &arena, policy, args.games, args.seed)? })
        };
        let own = model.join("policy");
        let own = if own.exists() { vec![play(&real(own)?)?] } else { Vec::new() };
        let mut learned = neural(&model, &system, Some(&Truth::Articulated.name()), args.device, args.starts)?;
        let protocol = PassiveConfig { starts: args.starts, steps: crate::paper::horizon("ant"), seed: args.seed, action: Action::Zero };
        let moved = passive(&system, &scene, &mut *Truth::Articulated.solver(&system), &mut learned, protocol, &mut |_| ())?;
        let guests = guests.iter().map(play).collect::<Result<Vec<_>>>()?;
        rows.push(Row {
            parameters: ModelConfig::read(&model)?.network.parameters(),
            microseconds: microseconds(&model, &system, &scene)?,
            error: summary(&system, &moved.error),
            // Those of the model that they were trained in are no guests.
            own: if model == Path::new(HOME) { guests.clone() } else { own },
            guests: if model == Path::new(HOME) { Vec::new() } else { guests },
            model,
        });
    }
    rows.sort_by(|a, b| a.microseconds.total_cmp(&b.microseconds));
    write(&args, &rows)
}

fn write(args: &TransferArgs, rows: &[Row]) -> Result<()> {
    let rewards = |all: &[Played]| {
        let words = all.iter().map(|p| format!("{:.0} / {:.0} ({:+.2} %)", p.real.mean, p.learned.mean, gap(p.real.mean, p.learned.mean)));
        together(all).map_or_else(|| "-".into(), |gap| format!("{}; together {gap:+.2} %", words.collect::<Vec<_>>().join(", ")))
    };
    let name = |row: &Row| row.model.display().to_string();
    let cells = rows
        .iter()
        .map(|r| vec![name(r), r.parameters.to_string(), digits(r.microseconds), pair(&r.error), rewards(&r.own), rewards(&r.guests)]);
    let table = markdown(
        &[
            "model",
            "parameters",
            "us a frame, one core",
            "passive, 500 frames (m, rad, rad)",
            "its own policies: truth / in it",
            "those of models/ant",
        ],
        &cells.collect::<Vec<_>>(),
    );
    let verdict = match rows.iter().find(|r| together(&r.own).is_some_and(|gap| gap.abs() < TRANSFERS)) {
        Some(row) => format!("The cheapest model whose own policies together have a gap below {TRANSFERS} %: {}.", name(row)),
        None => format!("No model's own policies together have a gap below {TRANSFERS} %."),
    };
    let stamp = Provenance::now(args.seed);
    let text = format!(
        "# Policies by the size of the network\n\nThe Ant's running policies, {} games each under mean actions: reward in the truth / in the model (gap).\n\n\
         {table}\n{verdict}\n\n`{}`, seed {}, commit {}, {}, {}\n",
        args.games, stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date,
    );
    println!("{text}");
    let stem = args.out.join("transfer");
    crate::files::write(&stem.with_extension("md"), text.as_bytes())?;
    let json = serde_json::json!({ "provenance": stamp, "rows": rows });
    crate::files::write(&stem.with_extension("json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    // Joined by size, and not by price, which small networks hardly differ in.
    let mut by_size: Vec<&Row> = rows.iter().collect();
    by_size.sort_by_key(|r| r.parameters);
    let points = |of: fn(&Row) -> &[Played]| {
        let point =
            |r: &&Row| together(of(r)).map(|gap| (r.microseconds, gap.abs(), name(r).rsplit('/').next().unwrap_or_default().to_string()));
        by_size.iter().filter_map(point).collect::<Vec<_>>()
    };
    let series = vec![
        Series { name: "trained in the model".into(), points: points(|r| &r.own) },
        Series { name: "trained in models/ant".into(), points: points(|r| &r.guests) },
    ];
    let figure = Figure {
        title: "Ant running: gap of the reward by size of the network".into(),
        x: "microseconds a frame, one environment, one core".into(),
        y: "gap of the mean reward (%)".into(),
        series: series.into_iter().filter(|s| !s.points.is_empty()).collect(),
        front: Vec::new(),
        levels: vec![(TRANSFERS, "transfers".into())],
    };
    Ok(figure.save(&stem)?)
}
