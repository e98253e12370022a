//! A cable that twists, against what theory says of shafts.

use std::f64::consts::PI;
use std::sync::Arc;

use nerd_sim::prelude::*;

const LINKS: usize = 60;
const LENGTH: f64 = 1.0;
const MASS: f64 = 0.08;
const DIAMETER: f64 = 0.008;

/// A clamped cable that hangs, in empty space.
fn shaft(twisting: f64, damping: f64) -> Arc<System> {
    let toml = format!(
        "[cable]\nlength = {LENGTH}\ndiameter = {DIAMETER}\nmass = {MASS}\nbending = 1e-3\ntwisting = {twisting}\ndamping = {damping}\n\
         links = {LINKS}\nheld = \"fixed\"\nalong = [0.0, 0.0, -1.0]\nat = [0.0, 0.0, 2.0]"
    );
    Arc::new(System::from_toml("shaft", &toml).expect("a cable"))
}

/// Places of the twisting joints among all.
fn twists(system: &System) -> Vec<usize> {
    let joints = system.robot.joints().enumerate().filter(|(_, j)| j.name.starts_with("twist"));
    joints.map(|(k, _)| k).collect()
}

fn simulation(system: &Arc<System>, state: &[f64]) -> Simulation {
    let mut batch = Batch::new(system, &system.scene("free").expect("a scene"), 1);
    batch.reset(0, state);
    Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(system)))
}

#[test]
fn a_shaft_under_torque_twists_by_its_length_over_its_stiffness() {
    let (twisting, torque) = (8e-4, 2e-4);
    let system = shaft(twisting, 2e-4);
    let joints = twists(&system);
    // A torque about the free end is felt by every joint alike.
    let mut torques = vec![0.0; system.robot.joint_count()];
    joints.iter().for_each(|k| torques[*k] = torque);
    let mut simulation = simulation(&system, &system.robot.zero_state());
    (0..600).for_each(|_| simulation.step(&torques).expect("it twists"));
    let angle: f64 = joints.iter().map(|k| simulation.batch.state(0)[*k]).sum();
    let theory = torque * LENGTH / twisting;
    println!("twist {angle:.5} rad, tau L / G J = {theory:.5}");
    assert!((angle / theory - 1.0).abs() < 0.01, "{angle} rad, theory {theory}");
}

/// The slowest way of a shaft that is clamped at one end takes `4 L sqrt(i / G J)`, with the polar inertia i of a metre of it.
#[test]
fn a_twisted_shaft_swings_back_in_the_time_of_theory() {
    let twisting = 8e-6;
    let system = shaft(twisting, 0.0);
    let (joints, mut state) = (twists(&system), system.robot.zero_state());
    // Its first mode: the angle grows as sin(pi s / 2 L), and the first joint stands for half a rod.
    let angle = |s: f64| 0.2 * (0.5 * PI * s / LENGTH).sin();
    let place = |k: usize| if k == 0 { 0.0 } else { (k as f64 - 0.5) / LINKS as f64 * LENGTH };
    joints.iter().enumerate().for_each(|(k, joint)| state[*joint] = angle(place(k + 1)) - angle(place(k)));
    let mut simulation = simulation(&system, &state);
    let torques = vec![0.0; system.robot.joint_count()];
    let (mut crossings, mut before) = (Vec::new(), 1.0);
    for frame in 1..=300 {
        simulation.step(&torques).expect("it swings");
        let now: f64 = joints.iter().map(|k| simulation.batch.state(0)[*k]).sum();
        if now * before < 0.0 {
            crossings.push((frame as f64 - now / (now - before)) * system.frame_time);
        }
        before = now;
    }
    let period = 2.0 * (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
    let polar = MASS / LENGTH * 0.5 * (0.5 * DIAMETER).powi(2);
    let theory = 4.0 * LENGTH * (polar / twisting).sqrt();
    println!("period {period:.5} s, theory {theory:.5} s, {} half swings", crossings.len());
    assert!(crossings.len() > 6 && (period / theory - 1.0).abs() < 0.01, "period {period} s, theory {theory} s");
}
