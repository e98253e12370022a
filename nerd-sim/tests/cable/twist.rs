//! A cable that twists, against what theory says of shafts.

use std::f64::consts::PI;

use super::{cable, common::*};

const LINKS: usize = 60;

/// A clamped cable that hangs, and the places of its twisting joints.
fn shaft(twisting: f64, damping: f64) -> (Arc<System>, Vec<usize>) {
    let hangs = "held = \"fixed\"\nalong = [0.0, 0.0, -1.0]\nat = [0.0, 0.0, 2.0]";
    let system = cable(&format!("bending = 1e-3\ntwisting = {twisting}\ndamping = {damping}\nlinks = {LINKS}\n{hangs}"));
    let joints = system.robot.joints().enumerate().filter(|(_, j)| j.name.starts_with("twist"));
    let joints = joints.map(|(k, _)| k).collect();
    (system, joints)
}

fn twist(state: &[f64], joints: &[usize]) -> f64 {
    joints.iter().map(|k| state[*k]).sum()
}

#[test]
fn a_shaft_under_torque_twists_by_its_length_over_its_stiffness() {
    let (twisting, torque) = (8e-4, 2e-4);
    let (system, joints) = shaft(twisting, 2e-4);
    // A torque about the free end is felt by every joint alike.
    let mut torques = vec![0.0; system.robot.joint_count()];
    joints.iter().for_each(|k| torques[*k] = torque);
    let (mut batch, mut solver) = (batch(&system, "free", 1), Articulated::new(ArticulatedConfig::accurate(&system)));
    (0..600).for_each(|_| solver.step(&mut batch, &torques).expect("it twists"));
    let (angle, theory) = (twist(&batch.states, &joints), torque / twisting);
    println!("twist {angle:.5} rad, tau L / G J = {theory:.5}");
    assert!((angle / theory - 1.0).abs() < 0.01, "{angle} rad, theory {theory}");
}

/// The slowest way of a shaft that is clamped at one end takes `4 L sqrt(i / G J)`, with the polar inertia i of a metre of it.
#[test]
fn a_twisted_shaft_swings_back_in_the_time_of_theory() {
    let twisting = 8e-6;
    let (system, joints) = shaft(twisting, 0.0);
    let mut state = system.robot.zero_state();
    // Its first mode: the angle grows as sin(pi s / 2 L), and the first joint has half a rod.
    let angle = |s: f64| 0.2 * (0.5 * PI * s).sin();
    let place = |k: usize| if k == 0 { 0.0 } else { (k as f64 - 0.5) / LINKS as f64 };
    joints.iter().enumerate().for_each(|(k, joint)| state[*joint] = angle(place(k + 1)) - angle(place(k)));
    let motion = motion(&mut Articulated::new(ArticulatedConfig::accurate(&system)), at(&system, "free", &state), 0.0, 300);
    let (mut crossings, mut before) = (Vec::new(), 1.0);
    for (frame, now) in motion.iter().map(|state| twist(state, &joints)).enumerate() {
        if now * before < 0.0 {
            crossings.push(((frame + 1) as f64 - now / (now - before)) * system.frame_time);
        }
        before = now;
    }
    let period = 2.0 * (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
    let polar = 0.08 * 0.5 * (0.5f64 * 0.008).powi(2);
    let theory = 4.0 * (polar / twisting).sqrt();
    println!("period {period:.5} s, theory {theory:.5} s");
    assert!(crossings.len() > 6 && (period / theory - 1.0).abs() < 0.01, "period {period} s, theory {theory} s");
}
