//! Dynamics of a URDF with nerd-core alone: `cargo run --release --manifest-path examples/Cargo.toml -p core-only -- my.urdf`.

use nerd_core::nalgebra::Vector3;
use nerd_core::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let urdf = match std::env::args().nth(1) {
        Some(path) => std::fs::read_to_string(path)?,
        None => include_str!("../arm.urdf").into(),
    };
    let robot = Robot::from_urdf(&urdf, false)?;
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let (q, qd, tau) = (vec![0.3; robot.nq()], vec![0.1; robot.nv()], vec![1.0; robot.nv()]);

    let mut data = Data::new(&robot);
    kinematics(&robot, &q, &mut data);
    crba(&robot, &mut data);
    println!("{}: {} joints, {:.2} kg, mass matrix {:.4}", robot.name, robot.joint_count(), robot.mass(), data.mass);
    if !aba(&robot, &qd, &tau, &gravity, &mut data) {
        return Err("a link has no inertia to accelerate".into());
    }
    let qdd = data.qdd.clone();
    rnea(&robot, &qd, qdd.as_slice(), &gravity, &mut data);
    println!("accelerations {qdd:.4}torques that they need {:.4}", data.tau);
    Ok(())
}
