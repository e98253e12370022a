//! `cargo xtask reproduce`: the main job. Rolls the shipped models out against the truths they learned (Cartpole 1000
//! frames, double pendulum 100 frames on its seven grounds), prints the table beside the paper's, draws speed against
//! accuracy. Minutes on two cores.
//!
//! Results go to `out/reproduce`; `--out results` replaces the committed ones.

use nerd_lab::experiments::passive::{Case, Passive, Protocol, Rows};
use nerd_lab::{experiments::chart::Chart, report::Artifact};
use nerd_train::shipped;

use crate::options::{DEVICES, SEEDS, STARTS};
use crate::{out::conduct, prelude::*};

/// Charts of it, robot and scene.
const CHARTS: [(&str, &str); 3] = [("cartpole", "free"), ("pendulum", "free"), ("pendulum", "ground1")];

/// Default folder of results.
const OWN: &str = "out/reproduce";

#[derive(clap::Args, Clone, Debug)]
pub struct ReproduceArgs {
    /// Trajectories by scene (the paper: 2048)
    #[arg(long, default_value_t = 256, value_parser = value::<usize>(Whole(STARTS)))]
    pub starts: usize,
    /// Leave the charts out
    #[arg(long)]
    pub tables_only: bool,
    /// Where the networks of the table are computed; those of the charts are on one CPU core
    #[arg(long, default_value_t = Device::Cpu, value_parser = word::<Device>(DEVICES))]
    pub device: Device,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = value::<u64>(Whole(SEEDS)))]
    pub seed: u64,
    /// Folder to write; `results` replaces the committed ones, unless those measured more [default: out/reproduce]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

pub fn run(args: ReproduceArgs) -> Result<()> {
    let out = args.out.clone().unwrap_or_else(|| shipped::root().join(OWN));
    let mut asked = Protocol::default();
    (asked.starts, asked.seed) = (args.starts, args.seed);
    let cases = Case::shipped(&asked, args.device)?;
    let before = Artifact::read(&shipped::results(), "passive").and_then(|found| found.parse::<Rows>());
    let rows: Rows = conduct(&Passive::new("passive", &cases)?, &out)?.parse()?;
    if let Some(agreement) = before.ok().and_then(|before| rows.agreement(&before)) {
        tell!("beside the committed results: {agreement}");
    }
    for (robot, scene) in CHARTS.into_iter().filter(|_| !args.tables_only) {
        let models = cases.iter().filter(|c| c.robot == robot).filter_map(|c| match &c.solver {
            Choice::Neural { folder, .. } => Some(folder.clone()),
            _ => None,
        });
        let mut chart = Chart::default();
        (chart.robot, chart.scene, chart.model, chart.seed) = (robot.into(), scene.into(), models.collect(), args.seed);
        conduct(&chart, &out)?;
    }
    Ok(())
}
