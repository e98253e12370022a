//! Dynamics of any URDF: `cargo run --release -p nerd-core --example dynamics`, or with the path of one behind `--`.

use nerd_core::nalgebra::Vector3;
use nerd_core::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let urdf = match std::env::args().nth(1) {
        Some(path) => std::fs::read_to_string(path)?,
        None => include_str!("../assets/pendulum.urdf").into(),
    };
    let robot = Robot::from_urdf(&urdf, false)?;
    let (q, qd, tau) = (vec![0.0; robot.nq()], vec![0.0; robot.nv()], vec![0.0; robot.nv()]);
    let mut data = Data::new(&robot);
    kinematics(&robot, &q, &mut data);
    crba(&robot, &mut data);
    println!("mass matrix {}", data.mass);
    if aba(&robot, &qd, &tau, &Vector3::new(0.0, -9.81, 0.0), &mut data) {
        println!("accelerations {}", data.qdd);
    }
    Ok(())
}
