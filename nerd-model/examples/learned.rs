//! The learned solver in the place of an analytic one: `cargo run --release -p nerd-model --example learned`.

use nerd_model::{folder::Model, neural::Neural};
use nerd_sim::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = System::named("pendulum")?;
    let batch = Batch::new(&system, &system.scene("ground1")?, 16);
    let model = Model::load(std::path::Path::new("models/pendulum"), &system, Some("articulated accurate"))?;
    let mut simulation = Simulation::new(batch, Neural::on_cpu(model, &system));
    for env in 0..16 {
        simulation.reset(env, &[1.0, 0.1 * env as f64, 0.0, 0.0]);
    }
    for _ in 0..100 {
        simulation.step(&[0.0; 16 * 2])?;
    }
    println!("{:?}", simulation.batch.state(15));
    Ok(())
}
