//! Holds an arm against gravity for two seconds: `cargo run --release -p nerd-sim --example hold -- my.urdf`.

use nerd_sim::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args()
        .nth(1)
        .unwrap_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/../nerd-core/assets/arm.urdf").into());
    let system = System::named(&path)?;
    let (robot, mut batch) = (&system.robot, Batch::new(&system, &system.scene("free")?, 1));
    for joint in robot.joints() {
        batch.set_joint(0, &joint.name, [0.3, 0.0])?;
    }
    let mut simulation = Simulation::new(batch, Truth::Articulated.solver(&system));
    let mut data = Data::new(robot);
    for _ in 0..(2.0 / system.frame_time) as usize {
        let (q, _) = robot.split(simulation.batch.state(0));
        let tau = data.gravity_torque(robot, q, &system.gravity());
        simulation.step(tau.as_slice())?;
    }
    for joint in robot.joints() {
        let [position, velocity] = simulation.batch.joint(0, &joint.name)?;
        println!("{}: moved by {:.1e} rad, now {velocity:.1e} rad/s", joint.name, position - 0.3);
    }
    Ok(())
}
