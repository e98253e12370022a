//! `cargo xtask dataset --robot pendulum --out data/pendulum`: records trajectories of a truth as safetensors shards,
//! from which `train` learns.
//!
//! Shards are written atomically; running the same command again keeps existing shards and adds missing ones.

use nerd_train::run::RecordConfig;

use crate::{options::TRANSITIONS, prelude::*};

#[derive(clap::Args)]
pub struct DatasetArgs {
    /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable .toml
    #[arg(long)]
    pub robot: String,
    #[command(flatten)]
    pub keys: Keys<RecordConfig>,
    /// Number of transitions to record, rounded up to whole trajectories
    #[arg(long, default_value_t = 1_000_000, value_parser = value::<usize>(Whole(TRANSITIONS)))]
    pub transitions: usize,
    /// Folder to write the shards into. The same command keeps existing shards and adds missing ones
    #[arg(long)]
    pub out: PathBuf,
}

pub fn run(args: DatasetArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    nerd_train::progress::notes(&system);
    let config = args.keys.settings()?;
    let started = std::time::Instant::now();
    let manifest = config.write(&system, args.transitions, &args.out)?;
    let n = manifest.trajectories * manifest.frames;
    let seconds = started.elapsed().as_secs_f64();
    say!(
        "{n} transitions in {} shards, {seconds:.1} s, {:.0} transitions/s, sha256 {}",
        manifest.shards.len(),
        n as f64 / seconds,
        manifest.sha256
    );
    Ok(())
}
