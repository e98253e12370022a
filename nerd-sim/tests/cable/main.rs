//! Cables: against theory, and the content of their files.

mod beam;
#[path = "../common/mod.rs"]
mod common;
mod file;

use nerd_sim::prelude::*;

/// A cable of 1 m, 80 g and 8 mm diameter, with more keys of `[cable]`.
fn cable(keys: &str) -> Arc<System> {
    let text = format!("[cable]\nlength = 1.0\ndiameter = 0.008\nmass = 0.08\n{keys}");
    Arc::new(System::from_toml("cable", &text).expect("a cable"))
}

/// Positions of the contact points, one at the end of each rod.
fn nodes(system: &System, state: &[f64]) -> Vec<Vector3<f64>> {
    let robot = &system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, &state[..robot.nq()], &mut data);
    robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local)).collect()
}

/// The accurate preset with another number of substeps.
fn accurate(system: &System, substeps: usize) -> Articulated {
    Articulated::new(ArticulatedConfig { substeps, contact_substeps: substeps, ..ArticulatedConfig::accurate(system) })
}
