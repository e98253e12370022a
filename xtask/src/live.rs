//! `cargo xtask live`: a robot in a browser on this machine, to be watched, pushed and given another solver while it moves.

use nerd_lab::live::{Live, Menu, World};
use nerd_model::pick::Setting;

use crate::prelude::*;

/// Ports that a user may name; 0 is any that is free.
const PORTS: std::ops::RangeInclusive<u64> = 0..=65535;

#[derive(clap::Args, Clone, Debug)]
pub struct LiveArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, each as NAME-paper too, or the path of a .urdf or MJCF (.xml)
    #[arg(long, required_unless_present = "policy")]
    pub robot: Option<String>,
    /// Scene [default: ground, or what the robot has first]
    #[arg(long)]
    pub scene: Option<String>,
    /// Folder of a policy that acts, in its own task
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["robot", "scene"])]
    pub policy: Option<PathBuf>,
    /// Folders of models to choose from, beside that in `models/ROBOT`
    #[arg(long, value_name = "FOLDER")]
    pub model: Vec<String>,
    /// Port of 127.0.0.1 [default: any that is free]
    #[arg(long, default_value = "0", hide_default_value = true, value_parser = value::<usize>(Whole(PORTS)))]
    pub port: usize,
}

pub fn run(args: LiveArgs) -> Result<()> {
    let models: Vec<PathBuf> = args.model.iter().flat_map(|models| listed(models)).map(PathBuf::from).collect();
    let world = World::of(Menu::new(args.robot.as_deref(), args.scene.as_deref(), args.policy.as_deref(), &models)?)?;
    for folder in models {
        Setting::Neural(folder).solver(&world.system)?;
    }
    let title = world.title.clone();
    let live = Live::serve(world, args.port as u16)?;
    say!("{title}: open {} (Ctrl-C ends it)", live.address());
    loop {
        std::thread::park();
    }
}
