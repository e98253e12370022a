//! `cargo xtask reproduce`: the main result. Compares rollouts of the shipped models with their truths. Cartpole runs
//! for 1000 frames, the double pendulum for 100 frames on its seven grounds. Prints the table beside the paper's and
//! draws speed against accuracy. Takes minutes on two cores.
//!
//! Results go to `out/reproduce`; `--out results` replaces the committed results.

use nerd_cli::experiments::passive::{Case, Passive, Protocol, Rows};
use nerd_cli::options::{DEVICES, SEEDS, STARTS};
use nerd_cli::{out::conduct, report::Artifact};
use nerd_lab::experiments::chart::Chart;
use nerd_train::shipped;

use crate::prelude::*;

/// Charts to draw, as (robot, scene).
const CHARTS: [(&str, &str); 3] = [("cartpole", "free"), ("pendulum", "free"), ("pendulum", "ground1")];

/// Folder of the results without --out.
const OWN: &str = "out/reproduce";

#[derive(clap::Args)]
pub struct ReproduceArgs {
    /// Number of trajectories in each scene (the paper: 2048)
    #[arg(long, default_value_t = 256, value_parser = value::<usize>(Whole(STARTS)))]
    pub trajectories: usize,
    /// Skips the charts
    #[arg(long)]
    pub tables_only: bool,
    /// Device of the networks in the table: cpu or cuda. Charts are measured on one CPU core
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = value::<u64>(Whole(SEEDS)))]
    pub seed: u64,
    /// Folder to write the results into. `results` replaces the committed results, unless those measured more [default:
    /// out/reproduce]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

pub fn run(args: ReproduceArgs) -> Result<()> {
    let out = args.out.clone().unwrap_or_else(|| shipped::root().join(OWN));
    let mut asked = Protocol::default();
    asked.trajectories = args.trajectories;
    asked.seed = args.seed;
    let cases = Case::shipped(&asked, args.device)?;
    let before = Artifact::read(&shipped::results(), "passive").and_then(|found| found.parse::<Rows>());
    let rows: Rows = conduct(&Passive::new("passive", &cases)?, &out)?.parse()?;
    if let Some(agreement) = before.ok().and_then(|before| rows.agreement(&before)) {
        tell!("beside the committed results: {agreement}");
    }
    for (robot, scene) in CHARTS.into_iter().filter(|_| !args.tables_only) {
        let models = cases.iter().filter(|c| c.robot == robot).filter_map(|c| c.solver.folder().map(PathBuf::from));
        let mut chart = Chart::default();
        chart.robot = robot.into();
        chart.scene = scene.into();
        chart.model = models.collect();
        chart.seed = args.seed;
        conduct(&chart, &out)?;
    }
    Ok(())
}
