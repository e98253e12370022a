//! Cables: against theory, and what their files may say.

mod beam;
#[path = "../common/mod.rs"]
mod common;
mod file;
mod twist;

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_sim::prelude::*;

/// A metre of 80 g and 8 mm, with more keys; `[cable]` is of the form that its file has.
fn cable(keys: &str) -> Arc<System> {
    let text = format!("[cable]\nlength = 1.0\ndiameter = 0.008\nmass = 0.08\n{keys}");
    Arc::new(System::from_toml("cable", &text).expect("a cable"))
}

/// Places of the contact points, one at the end of each rod.
fn nodes(system: &System, state: &[f64]) -> Vec<Vector3<f64>> {
    let robot = &system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, &state[..robot.nq()], &mut data);
    robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local)).collect()
}

/// The accurate preset with other substeps.
fn accurate(system: &System, substeps: usize) -> Articulated {
    Articulated::new(ArticulatedConfig { substeps, contact_substeps: substeps, ..ArticulatedConfig::accurate(system) })
}

/// Mean period (s) of a signal over frames that crosses zero, from the first crossing to the last; there must be some.
fn period(system: &System, signal: impl Iterator<Item = f64>) -> f64 {
    let (mut crossings, mut before) = (Vec::new(), 1.0);
    for (frame, now) in signal.enumerate() {
        if now * before < 0.0 {
            crossings.push(((frame + 1) as f64 - now / (now - before)) * system.frame_time);
        }
        before = now;
    }
    assert!(crossings.len() > 6, "{} half swings", crossings.len());
    2.0 * (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64
}
