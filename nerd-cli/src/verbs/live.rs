//! `cargo xtask live`: shows a simulated robot in a browser on this machine. The visitor pushes the robot and swaps its
//! solver while it moves.

use crate::live::{Live, Menu, World};
use crate::prelude::*;

/// Valid TCP ports; 0 stands for any free port.
const PORTS: std::ops::RangeInclusive<u64> = 0..=65535;

#[derive(clap::Args)]
pub struct LiveArgs {
    /// Robot: a name from `list robots` (pendulum, ant-paper, ...), or the path of a .urdf, MJCF (.xml) or cable .toml
    #[arg(long, required_unless_present = "policy")]
    pub robot: Option<String>,
    /// Scene at the start [default: ground, else the robot's first scene]
    #[arg(long)]
    pub scene: Option<String>,
    /// Folder of a policy that acts in its own task, in place of --robot and --scene
    #[arg(long, conflicts_with_all = ["robot", "scene"])]
    pub policy: Option<PathBuf>,
    /// Folders of models to choose from, comma-separated, in addition to `models/ROBOT`
    #[arg(long)]
    pub model: Vec<String>,
    /// TCP port on 127.0.0.1; 0 takes any free port [default: 0]
    #[arg(long, default_value = "0", hide_default_value = true, value_parser = value::<usize>(Whole(PORTS)))]
    pub port: usize,
}

pub fn run(args: LiveArgs) -> Result<()> {
    let models = args.model.iter().flat_map(|models| listed(models)).map(PathBuf::from).collect_vec();
    let world = World::of(Menu::new(args.robot.as_deref(), args.scene.as_deref(), args.policy.as_deref(), &models)?)?;
    for folder in models {
        SolverSpec::neural(folder).solver(&world.system, 1)?;
    }
    let title = world.title.clone();
    let live = Live::serve(world, args.port as u16)?;
    say!("{title}: open {} (Ctrl-C ends it)", live.address());
    loop {
        std::thread::park();
    }
}
