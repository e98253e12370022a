//! Gravity compensation of an arm: `cargo run --release -p nerd-core --example gravity -- my.urdf`.

use nerd_core::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path =
        std::env::args().nth(1).unwrap_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/assets/arm.urdf").into());
    let robot = Robot::from_urdf(&std::fs::read_to_string(path)?, Base::fixed())?;
    let (mut data, q) = (Data::new(&robot), vec![0.3; robot.nq()]); // rad, one per joint
    let tau = data.gravity_torque(&robot, &q, &Vector3::new(0.0, 0.0, -9.81)); // N m
    println!("{tau}");
    Ok(())
}
