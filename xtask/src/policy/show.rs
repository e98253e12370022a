//! `cargo xtask policy show --policy FOLDER --solver neural --out ant.html`: one episode as a page with everything in it.

use std::path::PathBuf;

use anyhow::Result;
use nerd_train::ppo::folder;
use nerd_train::ppo::rollout::Running;
use nerd_train::report::replay::Replay;

use super::arena::Arena;

/// Show a policy.
#[derive(clap::Args, Clone, Debug)]
pub struct ShowArgs {
    /// Folder of the policy
    #[arg(long)]
    pub policy: PathBuf,
    #[command(flatten)]
    pub arena: Arena,
    /// Seed of the start
    #[arg(long, default_value_t = 0, value_parser = crate::numbers::count::<u64>(crate::numbers::SEEDS))]
    pub seed: u64,
    /// HTML file to write
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

/// Runs the verb.
pub fn run(args: ShowArgs) -> Result<()> {
    args.arena.check()?;
    let (config, policy) = folder::load(&args.policy)?;
    let mut episodes = args.arena.episodes(&config.task, 1, args.seed)?;
    let title = format!("{} on {}", config.task, args.arena.title(episodes.task.robot())?);
    let bar = crate::common::bar(&title, episodes.task.episode_length());
    let dt = episodes.simulation.batch.system.frame_time * episodes.task.frames() as f64;
    let mut page = Replay::new(&title, &episodes.simulation.batch, dt);
    page.begin(&title);
    let (mut running, mut reached, mut total) = (Running::new(&episodes, policy.shape.stack), Vec::new(), 0.0);
    loop {
        page.add(&episodes.simulation.batch);
        page.goals.push(episodes.view(0).goal.iter().map(|x| *x as f32).collect());
        page.rewards.push(total as f32);
        let mean = policy.answer(&running.stack.rows).mean;
        let actions: Vec<f64> = mean.into_iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect();
        let stepped = running.step(&mut episodes, &actions, &mut reached)?;
        total += stepped.result.rewards[0];
        bar.set(page.frames() as u64);
        if !stepped.ended.is_empty() {
            break;
        }
    }
    bar.finish();
    println!("{title}: {} steps, reward {total:.1}; {}", page.frames(), args.out.display());
    crate::files::write(&args.out, page.html().as_bytes())
}
