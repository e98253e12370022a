//! Forward and inverse dynamics and gravity torques of a URDF, with nerd-core alone:
//! `cargo run --release --manifest-path examples/Cargo.toml -p core-only -- my.urdf`.

use nerd_core::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let urdf = match std::env::args().nth(1) {
        Some(path) => std::fs::read_to_string(path)?,
        None => include_str!("../arm.urdf").into(),
    };
    let robot = Robot::from_urdf(&urdf, Base::fixed())?;
    let (mut data, gravity) = (Data::new(&robot), Vector3::new(0.0, 0.0, -9.81));
    let (q, qd, tau) = (vec![0.3; robot.nq()], LocalVelocity(vec![0.1; robot.nv()]), vec![1.0; robot.nv()]);

    println!(
        "{}: {} joints, {:.2} kg, mass matrix {:.4}",
        robot.name,
        robot.joint_count(),
        robot.mass(),
        data.mass_matrix(&robot, &q)
    );
    let qdd = data.forward_dynamics(&robot, &q, &qd, &tau, &gravity)?.clone();
    let needed = data.inverse_dynamics(&robot, &q, &qd, qdd.as_slice(), &gravity);
    println!("accelerations {qdd:.4}torques that they need {needed:.4}");
    println!("torques that hold it still {:.4}", data.gravity_torque(&robot, &q, &gravity));
    Ok(())
}
