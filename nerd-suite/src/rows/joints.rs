//! Rows of joints: pendulums, limits, armature, robots in flight.

use std::f64::consts::FRAC_PI_2;

use super::*;
use crate::bodies::{chain, slider, universal};

pub(super) const ROWS: &[Row] = &[
    row(
        "pendulum period",
        "mean error of the angle, 3.5 periods",
        "amplitudes",
        0.01,
        "Newton tests; t = 2 pi sqrt(l/g) (1 + a^2/16)",
        "A wrong inertia or a step that brakes shows in the period first.",
        period,
    ),
    row(
        "pendulum energy",
        "change of energy, 1 rad, 2 s",
        "relative",
        5e-3,
        "Newton tests",
        "Nothing in it brakes, so what energy it loses or gains is the step's doing.",
        energy,
    ),
    row(
        "drive inertia",
        "error of the speed under a constant torque, 1 s",
        "relative",
        1e-4,
        "rapier tests; tau t / (I + armature)",
        "A motor's rotor adds to the inertia of its joint; whoever forgets it accelerates too fast.",
        armature,
    ),
    row(
        "joint limit",
        "depth beyond v sqrt(m/k), or gain of speed",
        "relative",
        0.1,
        "a spring's equation; a limit gives no energy",
        "A limit is a spring: a coarse step passes through it, or is thrown back faster than it came.",
        limit,
    ),
    row(
        "heavy end",
        "change of energy, 16 links, 1000:1, 2 s",
        "relative",
        0.05,
        "energy is constant; masses of rapier's test",
        "A heavy mass at the end of a light chain is what pulls joints apart that are only constraints.",
        heavy_end,
    ),
    row(
        "swinging arm",
        "change of energy, Franka without drives, 2 s",
        "relative",
        0.05,
        "energy is constant",
        "Seven coupled joints with a real arm's inertias: forces that are left out or late show as energy.",
        arm,
    ),
    row(
        "universal joint",
        "distance from the circle of a conical pendulum, 2 s",
        "radii",
        0.01,
        "w^2 = g / l cos a; 1 % of Newton's tests",
        "Two axes in one place: the first must carry the second along.",
        conical,
    ),
    row(
        "inner torques",
        "change of the Ant's momentum under random torques, 1 s",
        "relative",
        5e-4,
        "Newton tests, 5e-4; momentum theorem",
        "Motors push links against each other: the momentum of the whole is not theirs to change.",
        inner_torques,
    ),
    row(
        "falling quadruped",
        "change of ANYmal's energy, 1 s",
        "of what falling gave",
        5e-3,
        "energy is constant; SimBenchmark's drop",
        "A whole robot in the air: with all its joints moving, energy stays.",
        falling,
    ),
];

fn period(trial: &Trial) -> Result<f64> {
    let a = 0.05;
    let inertia = 1.0f64 + 1e-4;
    let system = chain(&[1.0], "", "1/60", GRAVITY)?;
    let omega = (GRAVITY / inertia).sqrt() * (1.0 - a * a / 16.0);
    let frames = (3.5 * std::f64::consts::TAU / omega * 60.0) as usize;
    let motion = trial.passive(&system, "free", &[FRAC_PI_2 + a, 0.0], frames)?;
    let gap = |(k, s): (usize, &Vec<f64>)| (s[0] - FRAC_PI_2 - a * (omega * k as f64 / 60.0).cos()).abs() / a;
    Ok(motion.states.iter().enumerate().map(gap).sum::<f64>() / motion.states.len() as f64)
}

fn energy(trial: &Trial) -> Result<f64> {
    Ok(kept(&trial.passive(&chain(&[1.0], "", "1/60", GRAVITY)?, "free", &[FRAC_PI_2 + 1.0, 0.0], 120)?))
}

/// Largest change of energy, divided by the largest kinetic energy. Returns 1 (a failure) if the centre of mass did not
/// move by 0.1 m.
fn kept(motion: &Motion) -> f64 {
    let totals = motion.totals();
    let e = motion.energies();
    let scale = most(totals.iter().map(|t| t.kinetic));
    let change = most(e.iter().map(|x| (x - e[0]).abs()));
    if totals.iter().any(|t| (t.com - totals[0].com).norm() > 0.1) { change / scale } else { 1.0 }
}

fn armature(trial: &Trial) -> Result<f64> {
    let system = chain(&[1.0], "armature = 0.5\n", "1/60", 0.0)?;
    let motion = trial.driven(&system, "free", &[0.0, 0.0], 60, &mut |_, tau| tau[0] = 1.0)?;
    Ok((motion.last()[1] * (1.0 + 1e-4 + 0.5) - 1.0).abs())
}

fn limit(trial: &Trial) -> Result<f64> {
    let motion = trial.passive(&slider()?, "free", &[0.0, 1.0], 60)?;
    let reach = most(motion.states.iter().map(|s| s[0]));
    // Fails if the slider stops before its limit, but for the small gap that a hard limit may leave.
    if reach < 0.49 {
        return Ok(1.0);
    }
    Ok(((reach - 0.5) / 0.01 - 1.0).max(motion.last()[1].abs() - 1.0).max(0.0))
}

fn heavy_end(trial: &Trial) -> Result<f64> {
    let mut masses = [1.0; 16];
    let mut state = [0.0; 32];
    masses[15] = 1000.0;
    state[0] = FRAC_PI_2 - 0.5;
    Ok(kept(&trial.passive(&chain(&masses, "", "1/60", GRAVITY)?, "free", &state, 120)?))
}

fn inner_torques(trial: &Trial) -> Result<f64> {
    let system = trial.robot("ant")?;
    let state = start(&system, Start::Sample, &mut stream(7, 0));
    let motion = trial.driven(&system, "free", &state, 60, &mut pushes(7, 1, 100.0))?;
    Ok(momentum_change(&motion, |first| first.mass * GRAVITY))
}

fn falling(trial: &Trial) -> Result<f64> {
    let system = trial.robot("anymal")?;
    let state = start(&system, Start::Sample, &mut stream(7, 0));
    Ok(kept(&trial.passive(&system, "free", &state, 60)?))
}

fn arm(trial: &Trial) -> Result<f64> {
    let mut system = (*trial.robot("franka")?).clone();
    for joint in system.robot.joints_mut() {
        joint.armature = 0.0;
        joint.damping = 0.0;
        joint.limit = None;
    }
    system.spec.gravity = [0.0, 0.0, -GRAVITY];
    let mut state = system.default_state();
    state[7..].fill(0.0);
    Ok(kept(&trial.passive(&Arc::new(system), "free", &state, 120)?))
}

fn conical(trial: &Trial) -> Result<f64> {
    let cone = 0.5f64;
    let omega = (GRAVITY / cone.cos()).sqrt();
    let motion = trial.passive(&universal()?, "free", &[0.0, -cone, cone.tan() * omega, 0.0], 120)?;
    let [a, b] = [0, 1].map(|k| motion.last()[k]);
    let x = -b.sin();
    let y = a.sin() * b.cos();
    let (s, c) = (2.0 * omega).sin_cos();
    Ok((x - cone.sin() * c).hypot(y - cone.sin() * s) / cone.sin())
}
