//! A task in formulas, reckoned on the CPU and written down for a graphics card: `cargo run --release -p nerd-tasks --example formulas`.

use nerd_sim::prelude::*;
use nerd_tasks::formula::{About, Formulas, Number, Sight, written};
use nerd_tasks::{Episodes, Task};

/// Hold the Cartpole's pole upright, near the middle of the rail. A state is (x, theta, x_dot, theta_dot).
struct Balance;

impl Formulas for Balance {
    fn about(&self) -> About {
        About { name: "balance", robot: "cartpole", scene: "free", observation: 4, action: 1, steps: 200, frames: 1 }
    }
    fn observe<N: Number>(&self, sight: &mut impl Sight<N>, out: &mut [N]) {
        out.copy_from_slice(&[sight.q(0), sight.q(1), sight.qd(0), sight.qd(1)]);
    }
    fn act<N: Number>(&self, _: &mut impl Sight<N>, action: &[N], torques: &mut [N]) {
        torques.copy_from_slice(&[N::from(400.0) * action[0], N::from(0.0)]);
    }
    fn reward<N: Number>(&self, sight: &mut impl Sight<N>, _: &[N]) -> N {
        N::from(1.0) - sight.q(0).squared() - sight.q(1).squared()
    }
    fn over<N: Number>(&self, sight: &mut impl Sight<N>) -> N {
        N::from(2.0).below(sight.q(0).abs()).or(N::from(0.5).below(sight.q(1).abs()))
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = System::named(Balance.robot())?;
    let batch = Batch::new(&system, &system.scene(Balance.scene())?, 4);
    let solver = Articulated::new(ArticulatedConfig::accurate(&system));
    let mut episodes = Episodes::new(Box::new(Balance), Simulation::new(batch, solver), 0);
    println!("rewards of a step: {:.3?}", episodes.step(&[0.1; 4])?.rewards);
    println!("{}", written(&Balance, &system)?);
    Ok(())
}
