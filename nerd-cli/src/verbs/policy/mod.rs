//! `cargo xtask policy train|evaluate|show|export|sim-to-sim`: trains policies on one solver, plays them on any, and
//! exports them.

use nerd_train::ppo::{Algorithm, Learned, PolicyRun, PpoConfig, folder};
use nerd_train::replay;

mod arena;
mod export;

use arena::ArenaArgs;
use export::ExportArgs;

use crate::experiments::{carried::Carried, policies::Policies};
use crate::options::MINUTES;
use crate::{conduct::Conduct, out, prelude::*};

#[derive(clap::Subcommand)]
pub enum PolicyVerb {
    /// Train a policy by PPO or SHAC, or continue a run
    Train(Box<TrainArgs>),
    /// Run policies in the truth and in the learned simulator, and compare their rewards
    #[command(mut_arg("out", written))]
    Evaluate(Conduct<Policies>),
    /// Write one episode as an HTML page that any browser replays
    Show(ShowArgs),
    /// Write a policy as ONNX, with a contract that describes its inputs and outputs
    Export(ExportArgs),
    /// Run policies in MuJoCo by their ONNX and contract alone, beside the truth
    #[command(mut_arg("out", written))]
    SimToSim(Conduct<Carried>),
}

fn written(out: clap::Arg) -> clap::Arg {
    out.help("Folder for the result; without it none is written")
}

#[derive(clap::Args)]
pub struct TrainArgs {
    /// Task: a name from `list tasks`, or the path of a task file (docs/tasks.md). The tasks walk, rough, stand and
    /// reach need --robot
    pub task: String,
    /// Robot of a task for any robot: a name from `list robots`, or a path (.urdf, MJCF .xml, cable .toml)
    #[arg(long)]
    pub robot: Option<String>,
    #[command(flatten)]
    pub arena: ArenaArgs,
    /// Algorithm: ppo learns from samples, shac from gradients of the simulator. Gradients exist for articulated and
    /// for models of single frames
    #[arg(long, value_parser = word::<Algorithm>(Algorithm::WORDS), default_value = "ppo", conflicts_with = "config")]
    pub algorithm: Algorithm,
    /// Settings of PPO: `paper`, or `small` for expensive steps [default: paper; on the CPU small with `neural`, with
    /// --robot and for task files]
    #[arg(long, value_parser = ["paper", "small"])]
    pub recipe: Option<String>,
    /// TOML file with all settings, `algorithm` included, in place of --recipe (examples: nerd-train/assets/ppo)
    #[arg(long, value_name = "FILE", conflicts_with = "recipe")]
    pub config: Option<PathBuf>,
    /// Number of environments [default: as in the settings]
    #[arg(long, value_parser = value::<usize>(Whole(1..=1 << 20)))]
    pub envs: Option<usize>,
    /// Steps of each environment in an iteration [default: as in the settings]
    #[arg(long, value_parser = value::<usize>(Whole(1..=1 << 16)))]
    pub horizon: Option<usize>,
    /// Iterations of the whole run [default: as in the settings]
    #[arg(long, value_parser = value::<u64>(Whole(1..=1_000_000_000)))]
    pub iterations: Option<u64>,
    /// Steps in a minibatch, at most those of an iteration [default: as in the settings]
    #[arg(long, value_parser = value::<usize>(Whole(1..=1 << 31)))]
    pub minibatch: Option<usize>,
    /// Minutes after which training stops with a checkpoint; the same command continues [default: no limit]
    #[arg(long, value_parser = value::<f64>(Positive(MINUTES)))]
    pub minutes: Option<f64>,
    /// Seed of initial weights, action noise and starts
    #[arg(long, default_value_t = 0, value_parser = value::<u64>(Whole(SEEDS)))]
    pub seed: u64,
    /// Folder of the run; the same command continues the run [default: out/policies/TASK-SOLVER-SEED, with
    /// --family out/policies/TASK-FAMILY-SOLVER-SEED]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

#[derive(clap::Args)]
pub struct ShowArgs {
    /// Folder of the policy
    #[arg(long)]
    pub policy: PathBuf,
    #[command(flatten)]
    pub arena: ArenaArgs,
    /// Seed of the start
    #[arg(long, default_value_t = 0, value_parser = value::<u64>(Whole(SEEDS)))]
    pub seed: u64,
    /// Commands of the task, such as vx=0.5,yaw_rate=0. The seed draws those that are not named
    #[arg(long, value_name = "NAME=NUMBER,...", allow_hyphen_values = true)]
    pub command: Option<String>,
    /// HTML file to write
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

pub fn run(verb: PolicyVerb) -> Result<()> {
    match verb {
        PolicyVerb::Train(args) => train(*args),
        PolicyVerb::Evaluate(args) => args.try_out(),
        PolicyVerb::Show(args) => show(args),
        PolicyVerb::Export(args) => args.run(),
        PolicyVerb::SimToSim(args) => args.try_out(),
    }
}

fn train(args: TrainArgs) -> Result<()> {
    let TrainArgs { task, robot, seed, minutes, .. } = args;
    let task = robot.map_or(task.clone(), |robot| format!("{task}@{robot}"));
    let arena = args.arena.of(&task)?;
    let gradients = args.algorithm == Algorithm::Shac;
    if gradients {
        unused(&[("--recipe", args.recipe.is_some())], "with --algorithm shac, which has one for each task")?;
    }
    let mut config = if gradients {
        PpoConfig::shac(&task)?
    } else {
        arena.settings(&task, args.recipe.as_deref(), args.config.as_deref())?
    };
    config.environments = args.envs.unwrap_or(config.environments);
    config.horizon = args.horizon.unwrap_or(config.horizon);
    let most = args.envs.or(args.horizon).map_or(usize::MAX, |_| config.steps());
    config.iterations = args.iterations.unwrap_or(config.iterations);
    config.minibatch = args.minibatch.unwrap_or(config.minibatch.min(most));
    let out =
        args.out.unwrap_or_else(|| format!("out/policies/{}-{}-{seed}", nerd_tasks::word(&task), arena.word()).into());
    let run = PolicyRun { task, arena, config, seed, minutes, out };
    say(&run.train()?);
    Ok(())
}

fn say(done: &Learned) {
    let reward = done.reward.map_or("no full set of episodes yet".into(), |r| {
        format!("best mean reward {r:.1} with noise (`policy evaluate` plays without)")
    });
    let seconds = done.elapsed.as_secs_f64();
    say!("{}: {reward} in {} iterations, {seconds:.0} s here; {}", done.title, done.iterations, done.policy.display());
    say!("{}", done.spent);
    if done.failed > 0 {
        let first = done.fault.as_ref().map_or_else(String::new, |fault| format!("; the first: {fault}"));
        tell!("{} episodes ended because the solver could not go on with them{first}", done.failed);
    }
    let rate = done.rate.map(|rate| format!("{rate:.0}"));
    let cells = [
        done.title.clone(),
        or_dash(done.reward),
        done.iterations.to_string(),
        or_dash(rate),
        done.policy.display().to_string(),
    ];
    out::keep(&Table::new("policy", ["run", "reward", "iterations", "steps/s", "folder"]).with([cells]));
}

fn show(args: ShowArgs) -> Result<()> {
    out::page(&args.out)?;
    let (config, policy) = folder::load(&args.policy)?;
    let task = config.task;
    let arena = args.arena.of(&task)?;
    let mut episodes = arena.episodes(&task, 1, args.seed)?;
    if let Some(Err(said)) = args.command.map(|command| episodes.ask(0, &command)) {
        bail!("--command: {said}");
    }
    let commands = episodes.task.commands();
    let asked = commands
        .iter()
        .zip(episodes.view(0).goal)
        .map(|((name, _), x)| format!(", {name} {}", (x * 1e3).round() / 1e3));
    let title = format!("{} in {}{}", folder::called(&args.policy)?, arena.title()?, asked.collect::<String>());
    let (page, reward) = replay::episode(&policy, &mut episodes, &title)?;
    say!("{title}: {} steps, reward {reward:.1}", page.frames());
    out::replay(&args.out, &page)
}
