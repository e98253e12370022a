//! Rollout of a shipped model with nerd-model alone:
//! `cargo run --release --manifest-path examples/Cargo.toml -p model-only -- models/pendulum`.

use std::path::Path;

use nerd_model::folder::ModelConfig;
use nerd_model::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pendulum");
    let folder = std::env::args().nth(1).unwrap_or_else(|| shipped.into());
    let config = ModelConfig::read(Path::new(&folder))?;
    let system = System::named(&config.robot)?;
    let model = Model::load(Path::new(&folder), &system, Some(&config.truth))?;

    let scene = system.scene(system.usual_scenes()[0])?;
    let mut simulation = Simulation::new(Batch::new(&system, &scene, 16), Neural::on_cpu(model));
    let torques = vec![0.0; 16 * system.robot.joint_count()];
    for _ in 0..100 {
        simulation.step(&torques)?;
    }
    println!(
        "{} in {} after {:.2} s: {:.3?}",
        system.name,
        scene.name,
        100.0 * system.frame_time,
        simulation.batch.state(0)
    );
    Ok(())
}
