//! Steps a batch on a GPU: `cargo run --release -p nerd-sim --features cuda --example card`.

use nerd_sim::articulated::device::{CudaArticulated, Real, Roll};
use nerd_sim::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = System::named("ant")?; // or the path of a .urdf
    let mut batch = Batch::new(&system, &system.scene("ground")?, 1024);
    let torques = vec![0.0; 1024 * system.robot.joint_count()];
    let mut solver = CudaArticulated::new(ArticulatedConfig::accurate(&system), Real::F32);
    // 100 frames of all environments in one call, without copies to the host in between.
    solver.roll(&mut batch, &torques, 100)?;
    println!("{:?}", batch.state(0));
    Ok(())
}
