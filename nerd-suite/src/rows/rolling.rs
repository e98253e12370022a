//! Rows of bodies that translate and rotate at once, where spatial acceleration differs from the time derivative of the
//! velocity.

use super::*;

pub(super) const ROWS: &[Row] = &[
    row(
        "level rolling",
        "change of height, 1 to 20 m/s, 5 s",
        "m",
        1e-4,
        "m g / k below the surface, at any speed",
        "A contact that takes the spatial acceleration -w x v of a rolling body for a change of velocity throws it off the ground.",
        |trial| level(trial, height),
    ),
    row(
        "level rolling, energy",
        "change of energy, 1 to 20 m/s, 5 s",
        "relative",
        1e-5,
        "rolling without slip does no work",
        "What a ball gains in height it gets from the step.",
        |trial| level(trial, energy),
    ),
    row(
        "spinning box on ice",
        "change of energy and height, 5 m/s, 20 rad/s, 2 s",
        "relative",
        1e-5,
        "no friction, no work",
        "Four corners circle while the box slides: none of them may lift it or slow it.",
        on_ice,
    ),
    row(
        "flat landing",
        "tilt after a spinning box has landed flat",
        "rad",
        1e-4,
        "symmetry",
        "A box that spins about the vertical and travels lands on all corners at once, and stays level.",
        flat,
    ),
    row(
        "low flight",
        "change of momentum beside the ground, 5 m/s, 1 s",
        "relative",
        1e-6,
        "momentum is constant",
        "With a ground near by the step is the one for contact, and must leave a free body alone.",
        low_flight,
    ),
];

/// Largest `figure` of a rolling ball over several velocities, with and without friction. A ball that did not travel as
/// far as it must counts as 1 (a failure).
fn level(trial: &Trial, figure: fn(&Motion) -> f64) -> Result<f64> {
    let radius = 0.1;
    worst([1.0, 5.0, 10.0, 20.0].into_iter().flat_map(|v| [(v, 0.0), (v, 0.5)]), |(speed, friction)| {
        let shape = format!(r#"<sphere radius="{radius}"/>"#);
        let body = Body { shape, inertia: [0.004; 3], material: [1e4, 100.0, 1e3, friction], ..Default::default() };
        // Lets the ball roll without slip: its lowest point has velocity 0.
        let spin = speed / radius;
        let place = [0.0, 0.0, radius - sunk(trial, &body, 1.0)];
        let start = Body::state(place, UPRIGHT, [0.0, spin, 0.0], [speed, 0.0, 0.0]);
        let motion = trial.passive(&body.system()?, "ground", &start, 300)?;
        let travelled = motion.last()[0] / (5.0 * speed);
        Ok(if f64::abs(travelled - 1.0) < 0.01 { figure(&motion) } else { 1.0 })
    })
}

fn height(motion: &Motion) -> f64 {
    most(motion.states.iter().map(|s| (s[2] - motion.states[0][2]).abs()))
}

/// Largest change of energy (springs included), divided by the start's energy.
fn energy(motion: &Motion) -> f64 {
    let e: Vec<f64> = motion.energies().iter().zip(motion.stored()).map(|(e, s)| e + s).collect();
    most(e.iter().map(|x| (x / e[0] - 1.0).abs()))
}

fn on_ice(trial: &Trial) -> Result<f64> {
    let body = Body { material: [1e4, 100.0, 1e3, 0.0], ..Default::default() };
    let place = [0.0, 0.0, 0.1 + 1e-5 - sunk(trial, &body, 4.0)];
    let start = Body::state(place, UPRIGHT, [0.0, 0.0, 20.0], [5.0, 0.0, 0.0]);
    let motion = trial.passive(&body.system()?, "ground", &start, 120)?;
    let slid = (motion.last()[0] / 10.0 - 1.0).abs() < 0.01;
    Ok(if slid { energy(&motion).max(height(&motion)) } else { 1.0 })
}

fn flat(trial: &Trial) -> Result<f64> {
    let body = Body { material: [1e4, 100.0, 1e3, 0.0], ..Default::default() };
    let start = Body::state([0.0, 0.0, 0.2], UPRIGHT, [0.0, 0.0, 20.0], [5.0, 0.0, 0.0]);
    let motion = trial.passive(&body.system()?, "ground", &start, 120)?;
    let tilt = |s: &Vec<f64>| (quaternion(&s[3..7]) * Vector3::z()).angle(&Vector3::z());
    let landed = (motion.last()[2] - 0.1).abs() < 0.01 && motion.last()[0] > 9.0;
    Ok(if landed { most(motion.states.iter().map(tilt)) } else { 1.0 })
}

fn low_flight(trial: &Trial) -> Result<f64> {
    let body = Body { gravity: 0.0, inertia: [0.01, 0.02, 0.03], ..Default::default() };
    let start = Body::state([0.0, 0.0, 0.3], UPRIGHT, [1.0, 5.0, 10.0], [5.0, 2.0, 0.0]);
    let motion = trial.passive(&body.system()?, "ground", &start, 60)?;
    let totals = motion.totals();
    let first = totals[0].momentum.lin;
    let way = vector(motion.last()) - vector(&motion.states[0]);
    let moved = (way - Vector3::new(5.0, 2.0, 0.0)).norm() / first.norm();
    Ok(most(totals.iter().map(|t| (t.momentum.lin - first).norm() / first.norm())).max(moved))
}
