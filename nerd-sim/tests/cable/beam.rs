//! Cables against the theory of beams and shafts; the stability suite covers hanging chains and energy.

use std::f64::consts::PI;

use super::{accurate, cable, common::*, nodes};

/// End (x, z) of a clamped beam of length 1 that bends under its own weight, with `c = w L^3 / E I`. The elastica is
/// `theta'' = c (1 - s) cos theta`, clamped at s = 0 and free at s = 1. Solved by shooting from the clamp with
/// bisection.
fn elastica(c: f64) -> [f64; 2] {
    let shoot = |bend: f64| {
        let (n, mut y) = (4000, [0.0, bend, 0.0, 0.0]);
        let h = 1.0 / n as f64;
        let rate = |s: f64, y: &[f64; 4]| [y[1], c * (1.0 - s) * y[0].cos(), y[0].cos(), y[0].sin()];
        for k in 0..n {
            let s = k as f64 * h;
            // Classical Runge-Kutta.
            let at = |y: &[f64; 4], d: &[f64; 4], by: f64| std::array::from_fn(|i| y[i] + by * h * d[i]);
            let a = rate(s, &y);
            let b = rate(s + 0.5 * h, &at(&y, &a, 0.5));
            let d = rate(s + 0.5 * h, &at(&y, &b, 0.5));
            let e = rate(s + h, &at(&y, &d, 1.0));
            y = std::array::from_fn(|i| y[i] + h / 6.0 * (a[i] + 2.0 * (b[i] + d[i]) + e[i]));
        }
        y
    };
    // The beam bends down: the curvature is negative at the clamp and rises to 0 at the end.
    let (mut low, mut high) = (-c, 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shoot(middle)[1] > 0.0 { high = middle } else { low = middle }
    }
    let end = shoot(low);
    [end[2], end[3]]
}

#[test]
fn a_clamped_cable_sags_as_the_elastica_says() {
    for (bending, links, within) in [(1.0, 20, 0.01), (0.2, 20, 0.01), (0.2, 40, 0.003), (0.05, 40, 0.01)] {
        let system = cable(&format!("bending = {bending}\ndamping = 0.02\nlinks = {links}\nsupport = \"fixed\""));
        let last = end(&mut accurate(&system, 4), batch(&system, "free", 1), 0.0, 900);
        let tip = nodes(&system, &last)[links - 1] - Vector3::new(0.0, 0.0, 1.0);
        let [x, z] = elastica(0.08 * 9.81 / bending);
        let off = (tip - Vector3::new(x, 0.0, z)).norm();
        assert!(off < within * z.abs(), "E I {bending}, {links} rods: {off} m off a sag of {z} m");
    }
}

#[test]
fn a_cable_let_go_comes_to_rest_on_the_floor() {
    let system = cable("bending = 1e-3\ndamping = 1e-5\nlinks = 40\nsupport = \"fixed\"\nposition = [0.0, 0.0, 0.3]");
    // With two substeps the cable never quite comes to rest.
    for (substeps, creep, bears) in [(2, 0.5, 0.2..0.9), (4, 0.01, 0.58..0.63), (16, 0.01, 0.58..0.63)] {
        let mut batch = batch(&system, "plane", 1);
        run(&mut accurate(&system, substeps), &mut batch, 0.0, 600);
        let state = batch.state(0);
        let lowest = nodes(&system, state).iter().map(|p| p.z - 0.004).fold(f64::INFINITY, f64::min);
        let speed = state[system.robot.nq()..].iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let held: f64 = batch.forces.iter().map(|f| f.z).sum();
        assert!(lowest > -1e-3, "x{substeps}: {lowest} m beneath the floor");
        assert!(speed < creep, "x{substeps}: {speed} rad/s after ten seconds");
        assert!(bears.contains(&held), "x{substeps}: the floor bears {held} N");
    }
}

/// A whipping cable can be solved with any number of substeps, since a substep too long for the motion is halved.
#[test]
fn a_whip_is_followed_at_any_number_of_substeps() {
    let system = cable("bending = 1e-3\ndamping = 1e-5\nlinks = 40\nsupport = \"fixed\"");
    let ends = [1, 2, 4, 16, 64].map(|substeps| {
        let swung = motion(&mut accurate(&system, substeps), batch(&system, "free", 1), 0.0, 300);
        nodes(&system, &swung[59])
    });
    let apart = ends.each_ref().map(|end| end.iter().zip(&ends[4]).map(|(a, b)| (a - b).norm()).sum::<f64>() / 40.0);
    assert!(apart[1] < 0.05 && apart[2] < 0.02 && apart[3] < 2e-3, "{apart:?} m after a second");
}

const LINKS: usize = 60;

/// A clamped cable that hangs, and the indices of its twisting joints.
fn shaft(twisting: f64, damping: f64) -> (Arc<System>, Vec<usize>) {
    let hangs = "support = \"fixed\"\ndirection = [0.0, 0.0, -1.0]\nposition = [0.0, 0.0, 2.0]";
    let system =
        cable(&format!("bending = 1e-3\ntwisting = {twisting}\ndamping = {damping}\nlinks = {LINKS}\n{hangs}"));
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
    // A torque about the free end acts on every joint alike.
    let mut torques = vec![0.0; system.robot.joint_count()];
    joints.iter().for_each(|k| torques[*k] = torque);
    let (mut batch, mut solver) = (batch(&system, "free", 1), Articulated::new(ArticulatedConfig::accurate(&system)));
    (0..600).for_each(|_| solver.step(&mut batch, &torques).expect("it twists"));
    let (angle, theory) = (twist(&batch.states, &joints), torque / twisting);
    assert!((angle / theory - 1.0).abs() < 0.01, "{angle} rad, theory {theory}");
}

/// The slowest oscillation of a shaft clamped at one end has the period `4 L sqrt(i / G J)`, with the polar inertia i
/// per metre.
#[test]
fn a_twisted_shaft_swings_back_in_the_time_of_theory() {
    let twisting = 8e-6;
    let (system, joints) = shaft(twisting, 0.0);
    let mut state = system.robot.zero_state();
    // The first mode: the angle is proportional to sin(pi s / 2 L), and the first joint has half a rod.
    let angle = |s: f64| 0.2 * (0.5 * PI * s).sin();
    let place = |k: usize| if k == 0 { 0.0 } else { (k as f64 - 0.5) / LINKS as f64 };
    joints.iter().enumerate().for_each(|(k, joint)| state[*joint] = angle(place(k + 1)) - angle(place(k)));
    let motion =
        motion(&mut Articulated::new(ArticulatedConfig::accurate(&system)), at(&system, "free", &state), 0.0, 300);
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
    assert!(crossings.len() > 6 && (period / theory - 1.0).abs() < 0.01, "period {period} s, theory {theory} s");
}
