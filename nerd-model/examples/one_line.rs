//! The README's example: one frame by the articulated solver, the next by the network.
//! `cargo run --release -p nerd-model --example one_line`.

use nerd_model::{folder::Model, neural::Neural};
use nerd_sim::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = System::named("pendulum")?; // or the path of a .urdf
    let batch = Batch::new(&system, &system.scene("ground1")?, 16);
    let mut simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)));
    simulation.reset(0, &[1.0, 0.5, 0.0, 0.0]);
    simulation.step(&[0.0; 16 * 2])?; // one frame of all sixteen environments, analytic

    let model = Model::load("models/pendulum".as_ref(), &system, Some("articulated accurate"))?;
    simulation.solver = Box::new(Neural::on_cpu(model));
    simulation.step(&[0.0; 16 * 2])?; // the next frame, by the network
    println!("{:?}", simulation.batch.state(0));
    Ok(())
}
