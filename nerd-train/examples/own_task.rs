//! A task of your own, played and learned: `cargo run --release -p nerd-train --example own_task`.

use nerd_tasks::{Task, View, Work};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Move the cart to a place and stop there.
pub struct CartTo;

impl Task for CartTo {
    fn name(&self) -> &'static str {
        "cart-to"
    }
    fn robot(&self) -> &'static str {
        "cartpole"
    }
    fn observation_dim(&self) -> usize {
        5 // x, theta, their speeds, and where to go
    }
    fn action_dim(&self) -> usize {
        1
    }
    fn episode_length(&self) -> u64 {
        300
    }
    fn goal_dim(&self) -> usize {
        1
    }
    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        out[0] = rng.random_range(-2.0..2.0);
    }
    fn observe(&self, view: View, _work: &mut Work, out: &mut [f64]) {
        out[..4].copy_from_slice(view.state);
        out[4] = view.goal[0];
    }
    fn act(&self, _view: View, action: &[f64], _work: &mut Work, torques: &mut [f64]) {
        torques.copy_from_slice(&[1500.0 * action[0].clamp(-1.0, 1.0), 0.0]);
    }
    fn reward(&self, view: View, _torques: &[f64], _work: &mut Work) -> f64 {
        let (away, speed) = (view.state[0] - view.goal[0], view.state[2]);
        1.0 - away * away - 0.1 * speed * speed
    }
    fn terminated(&self, view: View, _work: &mut Work) -> bool {
        view.state[0].abs() > 4.0
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    use nerd_sim::prelude::*;
    use nerd_tasks::Episodes;

    let system = System::named("cartpole")?;
    let batch = Batch::new(&system, &system.scene("free")?, 128);
    let truth = Truth::default().solver(&system);
    let mut episodes = Episodes::new(Box::new(CartTo), Simulation::new(batch, truth), 0);
    let result = episodes.step(&[0.5; 128])?;
    println!("{:?}", result.rewards);

    use nerd_train::ppo::{PpoConfig, Trainer};

    let settings = std::fs::read_to_string("nerd-train/assets/ppo/cartpole-small.toml")?; // 128 environments
    let config: PpoConfig = toml::from_str(&settings)?;
    let mut trainer = Trainer::new(episodes, config, 0)?;
    for _ in 0..trainer.config.iterations {
        let line = trainer.iterate()?;
        println!("{:?}", line.reward);
    }
    Ok(())
}
