//! `cargo xtask reproduce policies`: the shipped policies, played in the truth and in the simulator that learned it, beside the
//! paper's figures, into `results/policies.md` and `.json`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use nerd_train::ppo::folder::PolicyConfig;

use super::evaluate::{EvaluateArgs, row, table, write};
use crate::common::Device;
use crate::provenance::Provenance;

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
    #[arg(long, value_enum, default_value_t = Device::Flex)]
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
    let entries = std::fs::read_dir(&args.policies).with_context(|| format!("cannot read {}", args.policies.display()))?;
    let mut folders: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.join("config.json").exists()).collect();
    folders.sort();
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
    let table = table(&rows);
    println!("\nReward of a game under mean actions, mean and standard deviation:\n\n{table}");
    super::curves::draw(&configs, &args.out.join("policies"))?;
    write(&args.out.join("policies.json"), &rows, args.seed)?;
    let stamp = Provenance::now(args.seed);
    let from = format!("\n`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
    crate::files::write(&args.out.join("policies.md"), (table + &from).as_bytes())
}
