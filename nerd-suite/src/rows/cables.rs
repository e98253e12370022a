//! Rows of cables: long chains of rods, with and without springs between the rods.

use std::f64::consts::PI;

use super::*;
use nerd_sim::scene::points;

pub(super) const ROWS: &[Row] = &[
    row(
        "cable's sag",
        "error of the sag of a clamped cable, 16 rods, after 5 s",
        "relative",
        0.01,
        "beam theory: w L^4 / 8 E I; 1 %",
        "Springs between rods must bend as the cable does, and come to rest where its weight is borne.",
        sag,
    ),
    row(
        "hanging chain",
        "error of the end's swing, 20 rods, 4 s",
        "amplitudes",
        0.05,
        "D. Bernoulli 1733: omega = j / 2 sqrt(g / L), J0(j) = 0",
        "A long chain that swings in its slowest way shows whether weight and inertia are right all along it.",
        swing,
    ),
    row(
        "falling cable",
        "gain of energy while it falls onto the ground, 20 rods, 2 s",
        "of what falling gave",
        0.01,
        "energy never rises",
        "A whip's end is the fastest thing in a scene, and stiff springs and contact pay whoever passes over it.",
        fall,
    ),
];

fn cable(keys: &str) -> Result<Arc<System>> {
    let text = format!("[cable]\nlength = 1.0\ndiameter = 0.008\nmass = 0.08\nheld = \"fixed\"\n{keys}");
    Ok(Arc::new(System::from_toml("cable", &text)?))
}

fn end(system: &System, state: &[f64]) -> Vector3<f64> {
    points(&system.robot, state).pop().unwrap_or_default()
}

fn sag(trial: &Trial) -> Result<f64> {
    let system = cable("bending = 10.0\ndamping = 0.3\nlinks = 16")?;
    let motion = trial.passive(&system, "free", &system.robot.zero_state(), 300)?;
    let theory = 0.08 * GRAVITY / (8.0 * 10.0);
    Ok(((1.0 - end(&system, motion.last()).z) / theory - 1.0).abs())
}

/// Bessel function J0, by its power series.
fn bessel(x: f64) -> f64 {
    let term = |k: i32| (1..=k).fold(1.0, |t, i| -t * (0.5 * x / f64::from(i)).powi(2));
    (0..30).map(term).sum()
}

/// First zero of J0.
const ZERO: f64 = 2.404_825_557_695_773;

fn swing(trial: &Trial) -> Result<f64> {
    let system = cable("bending = 0.0\nlinks = 20\nalong = [0.0, 0.0, -1.0]")?;
    let place = |k: usize| 0.01 * bessel(ZERO * (1.0 - k as f64 / 20.0).sqrt());
    let slope = |k: usize| 20.0 * (place(k + 1) - place(k));
    let mut state = system.robot.zero_state();
    // Bends the chain in one plane: only the first hinge of each pair moves.
    (0..20).for_each(|k| state[2 * k] = if k == 0 { slope(0) } else { slope(k) - slope(k - 1) });
    let motion = trial.passive(&system, "free", &state, 240)?;
    let start = end(&system, &state).xy();
    let omega = 0.5 * ZERO * GRAVITY.sqrt();
    let gap = |(k, s): (usize, &Vec<f64>)| {
        (end(&system, s).xy().dot(&start) / start.norm_squared() - (omega * k as f64 / 60.0).cos()).abs()
    };
    Ok(motion.states.iter().enumerate().map(gap).sum::<f64>() / motion.states.len() as f64)
}

fn fall(trial: &Trial) -> Result<f64> {
    let system = cable("bending = 1e-3\ndamping = 1e-5\nlinks = 20\nat = [0.0, 0.0, 0.5]")?;
    let mut state = system.robot.zero_state();
    // Bends the cable slightly sideways, so that it does not fall in a plane.
    state[..40].iter_mut().step_by(2).enumerate().for_each(|(k, q)| *q = 0.1 * (PI * k as f64 / 10.0).sin());
    let motion = trial.passive(&system, "plane", &state, 120)?;
    let gain = rise(motion.energies().iter().zip(motion.stored()).map(|(a, b)| a + b));
    let heights = motion.totals();
    let fallen = most(heights.iter().map(|t| heights[0].com.z - t.com.z));
    Ok(if fallen > 0.1 { gain / (0.08 * GRAVITY * fallen) } else { 1.0 })
}
