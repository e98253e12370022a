//! An episode of a task on any solver: `cargo run --release -p nerd-tasks --example episode`.

use nerd_sim::prelude::*;
use nerd_tasks::{Episodes, named};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let task = named("cartpole-swingup")?;
    let system = System::named(task.robot())?;
    let batch = Batch::new(&system, &system.scene("free")?, 8);
    let solver = Articulated::new(ArticulatedConfig::accurate(&system));
    let mut episodes = Episodes::new(task, Simulation::new(batch, solver), 0);
    let result = episodes.step(&[0.5; 8])?;
    println!("{:?} {:?}", episodes.observations(), result.rewards);
    Ok(())
}
