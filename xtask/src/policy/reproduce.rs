//! `cargo xtask reproduce policies`: the shipped policies, played in the truth and in the simulator that learned it, beside the
//! paper's figures. `cargo xtask reproduce transfer`: their gaps by the size of the network that they were trained in.

use std::path::PathBuf;

use anyhow::Result;
use nerd_train::experiments::policies::Policies;
use nerd_train::experiments::transfer::Transfer;
use nerd_train::shipped::{folders, models, results};

use crate::common::{DEVICES, Device, word};
use crate::numbers::{SEEDS, STARTS, count};

/// Play all policies of a folder.
#[derive(clap::Args, Clone, Debug)]
pub struct PoliciesArgs {
    /// Folder of the policies' folders [default: models/policies]
    #[arg(long, value_name = "FOLDER")]
    pub policies: Option<PathBuf>,
    /// Games of each (the paper: 2048)
    #[arg(long, default_value_t = 512, value_parser = count::<usize>(STARTS))]
    pub games: usize,
    /// Where the learned simulators are computed
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Name of the result
    #[arg(long, default_value = "policies")]
    pub name: String,
    /// Folder to write into [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Plays them.
pub fn policies(args: PoliciesArgs) -> Result<()> {
    let PoliciesArgs { policies, games, device, seed, name, out } = args;
    let folders = folders(&policies.unwrap_or_else(|| models().join("policies")), "")?;
    crate::out::conduct(&Policies { name, folders, model: None, truth_only: false, games, seed, device }, &out.unwrap_or_else(results))
}

/// Draw policies' gaps against the size of the network.
#[derive(clap::Args, Clone, Debug)]
pub struct TransferArgs {
    /// Folders of models, comma-separated [default: models/sizes/ant-*, models/ant]
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Games of each policy (the paper: 2048)
    #[arg(long, default_value_t = 512, value_parser = count::<usize>(STARTS))]
    pub games: usize,
    /// Trajectories of passive motion
    #[arg(long, default_value_t = 128, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Where networks are computed; a frame is timed on the CPU
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder to write into [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Draws them.
pub fn transfer(args: TransferArgs) -> Result<()> {
    let TransferArgs { model, games, starts, device, seed, out } = args;
    let models = if model.is_empty() { Transfer::shipped()? } else { model };
    crate::out::conduct(&Transfer { models, games, starts, device, seed }, &out.unwrap_or_else(results))
}
