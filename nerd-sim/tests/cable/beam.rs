//! Cables against what theory says of beams and chains.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_sim::nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_sim::prelude::*;

fn cable(text: &str) -> Arc<System> {
    Arc::new(System::from_toml("cable", text).expect("a cable"))
}

/// Places of the contact points, one at the end of each rod.
fn nodes(system: &System, state: &[f64]) -> Vec<Vector3<f64>> {
    let robot = &system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, &state[..robot.nq()], &mut data);
    robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local)).collect()
}

fn simulation(system: &Arc<System>, scene: &str, substeps: usize) -> Simulation {
    let batch = Batch::new(system, &system.scene(scene).expect("a scene"), 1);
    let mut config = ArticulatedConfig::accurate(system);
    (config.substeps, config.contact_substeps) = (substeps, substeps);
    Simulation::new(batch, Articulated::new(config))
}

/// The end (x, z) of a clamped beam of length 1 that bends under its own weight, `c = w L^3 / E I`: `theta'' = c (1 - s) cos theta`, clamped at
/// s = 0, free at s = 1 (the elastica). Shooting from the clamp, by bisection.
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
    // It bends down: curvature at the clamp is negative and grows to 0 at the end.
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
        let (length, mass) = (1.0, 0.08);
        let text = format!(
            "[cable]\nlength = {length}\ndiameter = 0.008\nmass = {mass}\nbending = {bending}\ndamping = 0.02\nlinks = {links}\nheld = \"fixed\""
        );
        let system = cable(&text);
        let mut simulation = simulation(&system, "free", 4);
        let torques = vec![0.0; system.robot.joint_count()];
        (0..900).for_each(|_| simulation.step(&torques).expect("it moves"));
        let end = *nodes(&system, simulation.batch.state(0)).last().expect("an end") - Vector3::new(0.0, 0.0, length);
        let [x, z] = elastica(mass * 9.81 * length * length / bending);
        let off = (end - Vector3::new(x, 0.0, z)).norm();
        println!("E I {bending}, {links} rods: end at ({:.4}, {:.4}), theory ({x:.4}, {z:.4})", end.x, end.z);
        assert!(off < within * z.abs(), "{off} m off a sag of {z} m");
    }
}

/// Bessel's J0, by its series.
fn bessel(x: f64) -> f64 {
    let term = |k: i32| (1..=k).fold(1.0, |t, i| -t * (0.5 * x / i as f64).powi(2));
    (0..30).map(term).sum()
}

/// A chain that hangs swings in its first mode with `omega = j / 2 sqrt(g / L)`, j = 2.404826 the first zero of J0 (D. Bernoulli 1733).
#[test]
fn a_hanging_chain_swings_with_bernoullis_period() {
    let system =
        cable("[cable]\nlength = 1.0\ndiameter = 0.004\nmass = 0.1\nbending = 0.0\nlinks = 40\nheld = \"fixed\"\nalong = [0.0, 0.0, -1.0]");
    let (robot, n) = (&system.robot, 40);
    let place = |s: f64| 0.01 * bessel(2.404_826 * (1.0 - s).max(0.0).sqrt());
    let slope = |k: usize| n as f64 * (place((k + 1) as f64 / n as f64) - place(k as f64 / n as f64));
    let mut state = robot.zero_state();
    // Only the first hinge of each pair turns.
    for k in 0..n {
        state[2 * k] = if k == 0 { slope(0) } else { slope(k) - slope(k - 1) };
    }
    let mut simulation = simulation(&system, "free", 16);
    simulation.reset(0, &state);
    let end = |simulation: &Simulation| nodes(&system, simulation.batch.state(0))[n - 1].xy();
    let start = end(&simulation);
    let torques = vec![0.0; robot.joint_count()];
    let (mut crossings, mut before) = (Vec::new(), 1.0);
    for frame in 1..=600 {
        simulation.step(&torques).expect("it swings");
        let now = end(&simulation).dot(&start) / start.norm_squared();
        if now * before < 0.0 {
            crossings.push((frame as f64 - now / (now - before)) * system.frame_time);
        }
        before = now;
    }
    let period = 2.0 * (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
    let theory = 2.0 * std::f64::consts::PI / (0.5 * 2.404_826 * 9.81f64.sqrt());
    println!("period {period:.5} s, theory {theory:.5} s, {} half swings", crossings.len());
    assert!((period / theory - 1.0).abs() < 0.01, "period {period} s, theory {theory} s");
}

/// Kinetic energy, height and what its springs and those of the floor hold (J).
fn energy(system: &System, state: &[f64]) -> f64 {
    let robot = &system.robot;
    let (q, qd) = state.split_at(robot.nq());
    let mut data = Data::new(robot);
    kinematics(robot, q, &mut data);
    let height: f64 = robot.links.iter().enumerate().map(|(i, l)| l.inertia.mass * point_position(&data, i, &l.inertia.com).z).sum();
    nerd_sim::nerd_core::dynamics::crba(robot, &mut data);
    let qd = nalgebra::DVector::from_column_slice(qd);
    let springs: f64 = robot.joints().zip(q).map(|(j, q)| 0.5 * j.stiffness * (q - j.rest).powi(2)).sum();
    let depth = |p: &Vector3<f64>| (0.004 - p.z).max(0.0);
    let floor: f64 = nodes(system, q).iter().map(|p| 0.5 * system.spec.material.stiffness * depth(p).powi(2)).sum();
    0.5 * qd.dot(&(&data.mass * &qd)) + 9.81 * height + springs + floor
}

#[test]
fn a_cable_let_go_loses_energy_and_comes_to_rest_on_the_floor() {
    let system = cable(
        "[cable]\nlength = 1.0\ndiameter = 0.008\nmass = 0.08\nbending = 1e-3\ndamping = 1e-5\nlinks = 40\nheld = \"fixed\"\nat = [0.0, 0.0, 0.3]",
    );
    // With two it never quite comes to rest.
    for (substeps, rise, creep, bears) in [(2, 0.05, 0.5, 0.2..0.9), (4, 1e-6, 0.01, 0.58..0.63), (16, 1e-6, 0.01, 0.58..0.63)] {
        let mut simulation = simulation(&system, "plane", substeps);
        let torques = vec![0.0; system.robot.joint_count()];
        let (mut least, mut most) = (f64::INFINITY, 0.0f64);
        let whole = 0.08 * 9.81 * 0.3;
        for _ in 0..600 {
            simulation.step(&torques).expect("it falls");
            let now = energy(&system, simulation.batch.state(0));
            most = most.max((now - least) / whole);
            least = least.min(now);
        }
        let state = simulation.batch.state(0);
        let lowest = nodes(&system, state).iter().map(|p| p.z - 0.004).fold(f64::INFINITY, f64::min);
        let speed = state[system.robot.nq()..].iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let held: f64 = simulation.batch.forces.iter().map(|f| f.z).sum();
        println!(
            "x{substeps}: energy rose by {most:.1e} of the drop at most, lowest {lowest:.1e} m, {speed:.1e} rad/s, floor bears {held:.3} N"
        );
        assert!(most < rise, "x{substeps}: energy rises by {most} of what it falls through");
        assert!(lowest > -1e-3, "x{substeps}: {lowest} m beneath the floor");
        assert!(speed < creep, "x{substeps}: {speed} rad/s after ten seconds");
        assert!(bears.contains(&held), "x{substeps}: the floor bears {held} N");
    }
}

/// A cable that whips is solved at any number of substeps, since what is too fast is cut.
#[test]
fn a_whip_is_followed_at_any_number_of_substeps() {
    let system =
        cable("[cable]\nlength = 1.0\ndiameter = 0.008\nmass = 0.08\nbending = 1e-3\ndamping = 1e-5\nlinks = 40\nheld = \"fixed\"");
    let torques = vec![0.0; system.robot.joint_count()];
    let ends: Vec<Vec<Vector3<f64>>> = [1, 2, 4, 16, 64]
        .into_iter()
        .map(|substeps| {
            let mut simulation = simulation(&system, "free", substeps);
            (0..60).for_each(|_| simulation.step(&torques).expect("it swings"));
            let middle = nodes(&system, simulation.batch.state(0));
            (0..240).for_each(|_| simulation.step(&torques).expect("it whips"));
            middle
        })
        .collect();
    let off = |a: &[Vector3<f64>]| a.iter().zip(&ends[4]).map(|(a, b)| (a - b).norm()).sum::<f64>() / 40.0;
    let apart: Vec<f64> = ends.iter().map(|e| off(e)).collect();
    println!("after a second, m from 64 substeps: {apart:.4?}");
    assert!(apart[1] < 0.05 && apart[2] < 0.02 && apart[3] < 2e-3, "{apart:?} m after a second");
}

#[test]
fn what_is_no_cable_is_refused_in_a_line() {
    let usual = "[cable]\nlength = 1.0\ndiameter = 0.01\nmass = 0.1\nbending = 1e-3\n";
    let table = [
        ("length = 1.0", "length = 0.0", "length"),
        ("length = 1.0", "length = nan", "length"),
        ("diameter = 0.01", "diameter = 2.0", "diameter"),
        ("mass = 0.1", "mass = -1.0", "mass"),
        ("bending = 1e-3", "bending = -1e-3", "bending"),
        ("bending = 1e-3", "bending = 1e-3\nlinks = 0", "links"),
        ("bending = 1e-3", "bending = 1e-3\nlinks = 100000", "links"),
        ("bending = 1e-3", "bending = 1e-3\nalong = [0.0, 0.0, 0.0]", "along"),
        ("bending = 1e-3", "bending = 1e-3\nheld = \"glued\"", "held"),
        ("bending = 1e-3", "bending = 1e-3\nstiffness = 1.0", "stiffness"),
        ("[cable]", "floating = 3\n[cable]", "floating"),
        ("[cable]", "[wire]", "[cable]"),
    ];
    for (old, new, word) in table {
        let error = System::from_toml("lead", &usual.replace(old, new)).expect_err(new).to_string();
        assert!(error.contains(word) && !error.contains('\n') && error.contains("lead"), "{new}: {error}");
    }
}

#[test]
fn a_cable_is_held_as_it_is_said() {
    for (held, joints, mass) in [("gripper", 6 + 3 * 8, 0.1 * 9.0 / 8.0), ("fixed", 3 * 8, 0.1), ("free", 3 * 7, 0.1)] {
        let text = format!(
            "[cable]\nlength = 0.8\ndiameter = 0.01\nmass = 0.1\nbending = 1e-3\ntwisting = 8e-4\ndamping = 1e-5\nlinks = 8\nheld = \"{held}\""
        );
        let system = cable(&text);
        let robot = &system.robot;
        assert_eq!((robot.joint_count(), robot.floating()), (joints, held == "free"), "{held}");
        assert!((robot.mass() - mass).abs() < 1e-12, "{held}: {} kg", robot.mass());
        let end = *nodes(&system, &system.default_state()).last().expect("an end");
        assert!((end - Vector3::new(0.8, 0.0, 0.8)).norm() < 1e-12, "{held}: {end}");
        let mut simulation = simulation(&system, "plane", 8);
        simulation.reset(0, &system.default_state());
        (0..120).for_each(|_| simulation.step(&vec![0.0; joints]).expect("it falls"));
    }
}
