//! `cargo xtask reproduce policies`: the shipped policies, played in the truth and in the simulator that learned it, beside the
//! paper's figures, into `results/policies.md` and `.json`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use nerd_train::ppo::folder::PolicyConfig;

use super::evaluate::{EvaluateArgs, Row, gap as percent, row, table, write};
use crate::common::{DEVICES, Device, folders, word};
use crate::paper::policy_reward;
use crate::provenance::Provenance;
use crate::table::markdown;

/// Play all policies of a folder.
#[derive(clap::Args, Clone, Debug)]
pub struct PoliciesArgs {
    /// Folder of the policies' folders
    #[arg(long, default_value = "models/policies")]
    pub policies: PathBuf,
    /// Games of each (the paper: 2048)
    #[arg(long, default_value_t = 512)]
    pub games: usize,
    /// Where the learned simulators are computed
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of the starts
    #[arg(long, default_value_t = 500)]
    pub seed: u64,
    /// Folder to write
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
}

/// Runs the part.
pub fn run(args: PoliciesArgs) -> Result<()> {
    let folders = folders(&args.policies, "")?;
    if folders.is_empty() {
        bail!("no policy in {}", args.policies.display());
    }
    let (mut rows, mut configs) = (Vec::new(), Vec::new());
    for policy in folders {
        let text = std::fs::read_to_string(policy.join("config.json"))?;
        let config: PolicyConfig = serde_json::from_str(&text).with_context(|| policy.display().to_string())?;
        configs.push((policy.clone(), config.clone()));
        rows.push(row(&EvaluateArgs {
            task: config.task,
            policy,
            model: None,
            truth_only: false,
            games: args.games,
            seed: args.seed,
            device: args.device,
            out: None,
        })?);
    }
    let table = format!("{}\nEach policy:\n\n{}", by_task(&rows), table(&rows));
    println!("\nReward of a game under mean actions, mean and standard deviation, over all seeds:\n\n{table}");
    super::curves::draw(&configs, &args.out.join("policies"))?;
    write(&args.out.join("policies.json"), &rows, args.seed)?;
    let stamp = Provenance::now(args.seed);
    let from = format!("\n`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
    crate::files::write(&args.out.join("policies.md"), (table + &from).as_bytes())
}

/// Tasks with the means of their seeds, and their gaps.
fn by_task(rows: &[Row]) -> String {
    let mut lines = Vec::new();
    for task in nerd_tasks::names() {
        let of = |learned: bool| {
            rows.iter().filter(move |r| r.task == task && r.trained_in.starts_with("neural") == learned).collect::<Vec<_>>()
        };
        let (learned, truth) = (of(true), of(false));
        if learned.is_empty() && truth.is_empty() {
            continue;
        }
        let mean = |rows: &[&Row]| {
            let n = rows.len() as f64;
            let mean = rows.iter().map(|r| r.real.mean).sum::<f64>() / n;
            let square = |r: &&Row| r.real.spread.powi(2) + (r.real.mean - mean).powi(2);
            let spread = (rows.iter().map(square).sum::<f64>() / n).sqrt();
            if rows.is_empty() { "-".into() } else { format!("{mean:.1} +- {spread:.1}") }
        };
        let gaps: Vec<f64> = learned.iter().filter_map(|r| r.gap).collect();
        // As the paper's: of the means over seeds.
        let (real, played) =
            learned.iter().filter_map(|r| Some((r.real.mean, r.learned?.mean))).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let gap = if gaps.is_empty() { "-".into() } else { format!("{:+.2}", percent(real, played)) };
        let all = gaps.iter().map(|g| format!("{g:+.2}")).collect::<Vec<_>>().join(", ");
        let paper = policy_reward(task).map_or_else(Default::default, |p| (p[0].to_string(), format!("{:+.2}", percent(p[0], p[1]))));
        lines.push(vec![task.to_string(), mean(&learned), gap, all, mean(&truth), paper.0, paper.1]);
    }
    let header = ["task", "trained in NeRD: in truth", "gap (%)", "by seed", "trained in truth: in truth", "paper, in truth", "its gap"];
    markdown(&header, &lines)
}
