//! A hand-written task in an outside crate, trained to a policy in seconds:
//! `cargo run --release --manifest-path examples/Cargo.toml -p own-task`.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use nerd_train::nerd_sim::prelude::*;
use nerd_train::nerd_sim::sampling::{Start, start};
use nerd_train::nerd_tasks::formula::{Number, Sight, Traced};
use nerd_train::nerd_tasks::{About, ChaCha8Rng, Episodes, Plain, Task};
use nerd_train::ppo::folder::{PolicyConfig, load_for, save};
use nerd_train::ppo::{PpoConfig, Trainer, play};
use nerd_train::replay;

/// Hold the Cartpole's pole upright, near the middle of the rail. A state is (x, theta, x_dot, theta_dot).
struct Balance;

impl Task for Balance {
    fn about(&self) -> About {
        About { name: "balance", robot: "cartpole", scene: "free", observation: 4, action: 1, steps: 200, frames: 1 }
    }
    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out.copy_from_slice(&[sight.q(0), sight.q(1), sight.qd(0), sight.qd(1)]);
    }
    fn act<'a>(&self, _: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        torques[0] = 400.0 * action[0];
    }
    fn reward<'a>(&self, sight: &Sight<'a>, _: &[Traced<'a>]) -> Traced<'a> {
        1.0 - sight.q(0).squared() - sight.q(1).squared()
    }
    fn terminated<'a>(&self, sight: &Sight<'a>) -> Traced<'a> {
        let [far, low] = [(sight.q(0), 2.0), (sight.q(1), 0.5)].map(|(x, most)| Traced::from(most).below(x.abs()));
        far.or(low)
    }
    fn plain(&self) -> Option<&dyn Plain> {
        Some(self)
    }
}

/// Starts near the upright pose, in plain code.
impl Plain for Balance {
    fn reset(&self, system: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        start(system, Start::Reset, rng).iter().map(|x| 0.03 * x).collect()
    }
}

/// `count` episodes on the analytic solver; any other solver would do.
fn episodes(count: usize, seed: u64) -> Result<Episodes, Box<dyn Error>> {
    let system = System::named(Balance.robot())?;
    let batch = Batch::new(&system, &system.scene(Balance.scene())?, count);
    Ok(Episodes::new(Box::new(Balance), Simulation::new(batch, Truth::Articulated.solver(&system)), seed))
}

fn main() -> Result<(), Box<dyn Error>> {
    let ppo = PpoConfig { iterations: 60, ..PpoConfig::default() };
    let mut trainer = Trainer::new(episodes(ppo.environments, 0)?, ppo.clone(), 0)?;
    for _ in 0..ppo.iterations {
        let iteration = trainer.iterate()?;
        if iteration.step % 10 == 0 {
            println!("iteration {}: reward {:.1} of 200", iteration.step, iteration.reward.unwrap_or(f64::NAN));
        }
    }
    let (policy, reward) = trainer.best();
    let (folder, iterations) = (Path::new("out/balance"), ppo.iterations);
    let (task, solver, shape, provenance) =
        (Balance.name().into(), Truth::Articulated.name(), policy.shape.clone(), BTreeMap::new());
    save(
        folder,
        &PolicyConfig { task, solver, shape, ppo, iterations, reward, provenance },
        policy,
        "# A policy of `balance`\n",
    )?;

    let (_, policy) = load_for(folder, &Balance)?;
    let games = play(&policy, &mut episodes(64, 1)?, &mut |_| ())?;
    println!(
        "{}: {:.1} of 200 steps upright in 64 new episodes",
        folder.display(),
        games.iter().map(|g| g.length).sum::<f64>() / 64.0
    );

    let (page, _) = replay::episode(&policy, &mut episodes(1, 2)?, "balance")?;
    std::fs::write(folder.join("replay.html"), page.html())?;
    Ok(())
}
