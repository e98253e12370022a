//! `cargo xtask live`: a robot in a browser on this machine, to be watched, pushed and given another solver while it moves.

use nerd_lab::live::{Act, Live, World};
use nerd_model::pick::Setting;
use nerd_tasks::named;
use nerd_train::ppo::{Actor, Arena, Running, folder};
use nerd_train::shipped;

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
    #[arg(long, value_name = "FOLDER", value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Port of 127.0.0.1 [default: any that is free]
    #[arg(long, default_value = "0", hide_default_value = true, value_parser = value::<usize>(Whole(PORTS)))]
    pub port: usize,
}

pub fn run(args: LiveArgs) -> Result<()> {
    let (act, system, title) = match (&args.policy, &args.robot) {
        (Some(folder), _) => {
            let (config, policy) = folder::load(folder)?;
            let arena = Arena::Truth(named(&config.task)?.system()?.spec.truth);
            let episodes = arena.episodes(&config.task, 1, 0)?;
            let system = episodes.simulation.batch.system.clone();
            let running = Running::new(&episodes, policy.shape.stack);
            (Act::Policy(Box::new((episodes, running, Actor::new(policy)))), system, config.task)
        }
        (None, robot) => {
            let system = System::named(robot.as_deref().unwrap_or_default())?;
            let scenes = system.scene_names();
            let usual = scenes.iter().find(|s| **s == "ground").or(scenes.get(1)).unwrap_or(&scenes[0]);
            let scene = system.scene(args.scene.as_deref().unwrap_or(usual))?;
            let mut batch = Batch::new(&system, &scene, 1);
            batch.reset(0, &system.default_state());
            let title = format!("{} in {}", system.name, scene.name);
            (Act::Alone(Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)))), system, title)
        }
    };
    let shipped = Some(shipped::model(system.spec.truth, &system.name)).filter(|folder| folder.exists());
    let mut settings = vec![Setting::from(system.spec.truth), Setting::Implicit(1), Setting::Implicit(4), Setting::RapierSteps(4)];
    settings.extend(shipped.into_iter().chain(args.model.iter().cloned()).map(Setting::Neural));
    for folder in &args.model {
        Setting::Neural(folder.clone()).solver(&system)?;
    }
    let live = Live::serve(World::new(act, settings)?, &title, args.port as u16)?;
    say!("{title}: open {}; Ctrl-C ends it", live.address());
    loop {
        std::thread::park();
    }
}
