//! Dynamics of any URDF: `cargo run --release -p nerd-core --example dynamics`.

use nerd_core::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let urdf = include_str!("../../nerd-sim/assets/pendulum.urdf"); // or std::fs::read_to_string of your own
    let robot = Robot::from_urdf(urdf, false)?;
    let (q, qd, tau) = ([0.3, -0.2], [0.0, 0.0], [0.0, 0.0]);
    let mut data = Data::new(&robot);
    kinematics(&robot, &q, &mut data);
    crba(&robot, &mut data);
    println!("mass matrix {}", data.mass);
    if aba(&robot, &qd, &tau, &nalgebra::Vector3::new(0.0, -9.81, 0.0), &mut data) {
        println!("accelerations {}", data.qdd);
    }
    Ok(())
}
