//! Rows of joints: pendulums, limits, drives, robots in flight.

use std::f64::consts::FRAC_PI_2;

use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use rand::RngExt;

use super::row::Row;
use super::trial::{Fault::*, Motion, Trial};
use super::worlds::{chain, slider, universal};

const G: f64 = 9.81;

pub const ROWS: [Row; 9] = [
    Row {
        name: "pendulum period",
        figure: "mean error of the angle, 3.5 periods (amplitudes)",
        source: "Newton tests; t = 2 pi sqrt(l/g) (1 + a^2/16)",
        limit: 0.01,
        reddens: &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: period,
    },
    Row {
        name: "pendulum energy",
        figure: "change of energy, 1 rad, 2 s (relative)",
        source: "Newton tests",
        limit: 5e-3,
        reddens: &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: energy,
    },
    Row {
        name: "drive inertia",
        figure: "error of the speed under a constant torque, 1 s (relative)",
        source: "rapier tests; tau t / (I + armature)",
        limit: 1e-4,
        reddens: &[DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: armature,
    },
    Row {
        name: "joint limit",
        figure: "depth beyond v sqrt(m/k), or gain of speed (relative)",
        source: "a spring's equation; a limit gives no energy",
        limit: 0.1,
        reddens: &[DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: limit,
    },
    Row {
        name: "heavy end",
        figure: "change of energy, 16 links, 1000:1, 2 s (relative)",
        source: "energy is constant; masses of rapier's test",
        limit: 0.05,
        reddens: &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: heavy_end,
    },
    Row {
        name: "swinging arm",
        figure: "change of energy, Franka without drives, 2 s (relative)",
        source: "energy is constant",
        limit: 0.05,
        reddens: &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: arm,
    },
    Row {
        name: "universal joint",
        figure: "distance from the circle of a conical pendulum, 2 s (radii)",
        source: "w^2 = g / l cos a; 1 % of Newton's tests",
        limit: 0.01,
        reddens: &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: conical,
    },
    Row {
        name: "inner torques",
        figure: "change of the Ant's momentum under random torques, 1 s (relative)",
        source: "Newton tests, 5e-4; momentum theorem",
        limit: 5e-4,
        reddens: &[HalfGravity, DroppedVelocity, BodyAngularVelocity, FrozenWorld, PumpedVelocity],
        measure: inner_torques,
    },
    Row {
        name: "falling quadruped",
        figure: "change of ANYmal's energy, 1 s (of what falling gave)",
        source: "energy is constant; SimBenchmark's drop",
        limit: 5e-3,
        reddens: &[HalfGravity, DroppedVelocity, FrozenWorld, PumpedVelocity],
        measure: falling,
    },
];

fn period(trial: &Trial) -> Result<f64, String> {
    let (a, inertia) = (0.05, 1.0f64 + 1e-4);
    let system = chain(&[1.0], "", "1/60", G)?;
    let omega = (G / inertia).sqrt() * (1.0 - a * a / 16.0);
    let frames = (3.5 * std::f64::consts::TAU / omega * 60.0) as usize;
    let motion = trial.passive(&system, "free", &[FRAC_PI_2 + a, 0.0], frames)?;
    let gap = |(k, s): (usize, &Vec<f64>)| (s[0] - FRAC_PI_2 - a * (omega * k as f64 / 60.0).cos()).abs() / a;
    Ok(motion.states.iter().enumerate().map(gap).sum::<f64>() / motion.states.len() as f64)
}

fn energy(trial: &Trial) -> Result<f64, String> {
    let motion = trial.passive(&chain(&[1.0], "", "1/60", G)?, "free", &[FRAC_PI_2 + 1.0, 0.0], 120)?;
    Ok(kept(&motion))
}

/// Largest change of energy against the largest kinetic energy; 1 if the centre of mass did not move by 0.1 m.
fn kept(motion: &Motion) -> f64 {
    let (totals, e) = (motion.totals(), motion.energies());
    let scale = totals.iter().map(|t| t.kinetic).fold(0.0, f64::max);
    let change = e.iter().map(|x| (x - e[0]).abs()).fold(0.0, f64::max);
    if totals.iter().any(|t| (t.com - totals[0].com).norm() > 0.1) { change / scale } else { 1.0 }
}

fn armature(trial: &Trial) -> Result<f64, String> {
    let system = chain(&[1.0], "armature = 0.5\n", "1/60", 0.0)?;
    let motion = trial.driven(&system, "free", &[0.0, 0.0], 60, &mut |_, _, tau| tau[0] = 1.0)?;
    Ok((motion.last()[1] * (1.0 + 1e-4 + 0.5) - 1.0).abs())
}

fn limit(trial: &Trial) -> Result<f64, String> {
    let motion = trial.passive(&slider()?, "free", &[0.0, 1.0], 60)?;
    let reach = motion.states.iter().map(|s| s[0]).fold(0.0, f64::max);
    // A hard limit holds a hair before its end.
    if reach < 0.49 {
        return Ok(1.0);
    }
    Ok(((reach - 0.5) / 0.01 - 1.0).max(motion.last()[1].abs() - 1.0).max(0.0))
}

fn heavy_end(trial: &Trial) -> Result<f64, String> {
    let mut masses = [1.0; 16];
    masses[15] = 1000.0;
    let mut state = vec![0.0; 32];
    state[0] = FRAC_PI_2 - 0.5;
    let motion = trial.passive(&chain(&masses, "", "1/60", G)?, "free", &state, 120)?;
    Ok(kept(&motion))
}

fn inner_torques(trial: &Trial) -> Result<f64, String> {
    let system = System::named("ant").map_err(|e| e.to_string())?;
    let state = start(&system, Start::Sample, &mut stream(7, 0));
    let mut rng = stream(7, 1);
    let mut push = |_: usize, _: &[f64], tau: &mut [f64]| tau.iter_mut().for_each(|t| *t = 200.0 * rng.random::<f64>() - 100.0);
    let motion = trial.driven(&system, "free", &state, 60, &mut push)?;
    let totals = motion.totals();
    let first = &totals[0];
    let change = totals.iter().enumerate().map(|(k, t)| {
        let given = system.gravity() * (first.mass * k as f64 / 60.0);
        let (l, p) = (t.momentum.ang - first.momentum.ang, t.momentum.lin - first.momentum.lin - given);
        (l.norm() / first.momentum.ang.norm()).max(p.norm() / (first.mass * G))
    });
    Ok(change.fold(0.0, f64::max))
}

fn falling(trial: &Trial) -> Result<f64, String> {
    let system = System::named("anymal").map_err(|e| e.to_string())?;
    let state = start(&system, Start::Sample, &mut stream(7, 0));
    let motion = trial.passive(&system, "free", &state, 60)?;
    Ok(kept(&motion))
}

fn arm(trial: &Trial) -> Result<f64, String> {
    let mut system = (*System::named("franka").map_err(|e| e.to_string())?).clone();
    for joint in system.robot.joints_mut() {
        (joint.armature, joint.damping, joint.limit) = (0.0, 0.0, None);
    }
    system.spec.gravity = [0.0, 0.0, -G];
    let mut state = system.default_state();
    state[7..].fill(0.0);
    Ok(kept(&trial.passive(&std::sync::Arc::new(system), "free", &state, 120)?))
}

fn conical(trial: &Trial) -> Result<f64, String> {
    let cone = 0.5f64;
    let omega = (G / cone.cos()).sqrt();
    let motion = trial.passive(&universal()?, "free", &[0.0, -cone, cone.tan() * omega, 0.0], 120)?;
    let [a, b] = [motion.last()[0], motion.last()[1]];
    let (x, y) = (-b.sin(), a.sin() * b.cos());
    let (s, c) = (2.0 * omega).sin_cos();
    Ok((x - cone.sin() * c).hypot(y - cone.sin() * s) / cone.sin())
}
