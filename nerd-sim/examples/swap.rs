//! A batch, a scene, a solver, another solver: `cargo run --release -p nerd-sim --features rapier --example swap`.

use nerd_sim::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = System::named("pendulum")?; // or the path of a .urdf
    let scene = system.scene("ground1")?;
    let batch = Batch::new(&system, &scene, 1024);
    let mut simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)));
    simulation.reset(0, &[1.0, 0.5, 0.0, 0.0]);
    for _ in 0..100 {
        simulation.step(&vec![0.0; 1024 * 2])?;
    }
    println!("{:?}", simulation.batch.state(0));
    simulation.solver = Box::new(Rapier::new(RapierConfig::default())); // the rest goes on unchanged
    simulation.step(&vec![0.0; 1024 * 2])?;
    println!("{:?}", simulation.batch.state(0));
    Ok(())
}
