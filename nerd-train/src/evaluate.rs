//! Passive motion: how far a solver drifts from the truth, from equal starts, without torques (paper 5.1; protocol of
//! the reference system: starts from the reset law, mean over every step and every trajectory of the absolute
//! difference by coordinate, endless angles wrapped).
//!
//! Beside each figure stand two floors, predictors that know no dynamics: `hold` repeats the start, `glide` goes on
//! at the start's velocity. A rollout that diverges is counted and stays in every mean.

use std::sync::Arc;

use nerd_core::state::wrap;
use nerd_sim::batch::Batch;
use nerd_sim::sampling::{Start, start, stream};
use nerd_sim::scene::Scene;
use nerd_sim::solver::{Solver, StepError};
use nerd_sim::system::System;
use serde::{Deserialize, Serialize};

/// What to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PassiveConfig {
    /// Trajectories (paper: 2048).
    pub starts: usize,
    /// Frames (paper: 100 for the pendulum, 1000 for Cartpole).
    pub steps: usize,
    /// Seed of the starts (reference: 500).
    pub seed: u64,
}

/// Errors of one solver against the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PassiveReport {
    /// Mean |difference| by coordinate of q over all steps and trajectories (rad or m).
    pub error: Vec<f64>,
    /// Standard error of that mean over trajectories.
    pub standard_error: Vec<f64>,
    /// The same mean for the predictor that repeats the start.
    pub hold: Vec<f64>,
    /// The same mean for the predictor that keeps the start's velocity.
    pub glide: Vec<f64>,
    /// Mean |difference| averaged over q by step, from step 1.
    pub curve: Vec<f64>,
    /// Rollouts whose speed in some coordinate passed three times the truth's largest, or that left 1e5.
    pub diverged: usize,
    /// First step at which a rollout diverged.
    pub first_divergence: Option<usize>,
}

/// Rolls `truth` and `solver` out from the same starts; `progress` is told after each step.
pub fn passive(
    system: &Arc<System>,
    scene: &Arc<Scene>,
    truth: &mut dyn Solver,
    solver: &mut dyn Solver,
    config: PassiveConfig,
    progress: &mut dyn FnMut(usize),
) -> Result<PassiveReport, StepError> {
    let robot = &system.robot;
    let (n, joints, coords) = (config.starts, robot.joint_count(), robot.root_coords());
    let mut real = Batch::new(system, scene, n);
    for env in 0..n {
        let state = start(system, Start::Reset, &mut stream(config.seed, env as u64));
        real.reset(env, &state);
    }
    let mut learned = real.clone();
    (0..n).for_each(|env| {
        truth.reset(env);
        solver.reset(env);
    });
    let first = real.clone();
    let wraps: Vec<bool> = robot.joints().map(|j| j.wraps()).collect();
    let gap = |k: usize, a: f64, b: f64| if wraps[k] { wrap(a - b).abs() } else { (a - b).abs() };
    let torques = vec![0.0; n * joints];
    // Sums of |difference| over steps, by trajectory and joint: of the solver, of hold, of glide.
    let mut sums = [vec![0.0; n * joints], vec![0.0; n * joints], vec![0.0; n * joints]];
    let mut curve = Vec::with_capacity(config.steps);
    let (mut fastest, mut speeds) = (0.0f64, vec![0.0f64; n]);
    let mut gone: Vec<Option<usize>> = vec![None; n];
    // |difference| of a rollout that is gone, as it was when it went: it stays in the mean at that.
    let mut frozen = vec![0.0; n * joints];
    let rates = robot.nq() + robot.root_dofs();
    for step in 1..=config.steps {
        truth.step(&mut real, &torques)?;
        solver.step(&mut learned, &torques)?;
        let time = step as f64 * system.frame_time;
        let mut total = 0.0;
        for env in 0..n {
            let (a, b, s) = (real.state(env), learned.state(env), first.state(env));
            for k in 0..joints {
                let (q, q0) = (a[coords + k], s[coords + k]);
                let e = if gone[env].is_some() { frozen[env * joints + k] } else { gap(k, q, b[coords + k]) };
                frozen[env * joints + k] = e;
                total += e;
                sums[0][env * joints + k] += e;
                sums[1][env * joints + k] += gap(k, q, q0);
                sums[2][env * joints + k] += gap(k, q, q0 + s[rates + k] * time);
                fastest = fastest.max(a[rates + k].abs());
                speeds[env] = speeds[env].max(b[rates + k].abs());
            }
            if gone[env].is_none() && b.iter().any(|x| x.abs() > 1e5) {
                gone[env] = Some(step);
            }
            if gone[env].is_some() {
                // Out of the way of overflow.
                let held = first.state(env).to_vec();
                learned.reset(env, &held);
                solver.reset(env);
            }
        }
        curve.push(total / (n * joints) as f64);
        progress(step);
    }
    let mean = |sums: &[f64], k: usize| sums.iter().skip(k).step_by(joints).sum::<f64>() / (n * config.steps) as f64;
    let spread = |k: usize| {
        let m = mean(&sums[0], k);
        let square = |s: &f64| (s / config.steps as f64 - m).powi(2);
        (sums[0].iter().skip(k).step_by(joints).map(square).sum::<f64>() / (n.max(2) - 1) as f64 / n as f64).sqrt()
    };
    let fast = |env: &usize| speeds[*env] > 3.0 * fastest || gone[*env].is_some();
    Ok(PassiveReport {
        error: (0..joints).map(|k| mean(&sums[0], k)).collect(),
        standard_error: (0..joints).map(spread).collect(),
        hold: (0..joints).map(|k| mean(&sums[1], k)).collect(),
        glide: (0..joints).map(|k| mean(&sums[2], k)).collect(),
        curve,
        diverged: (0..n).filter(fast).count(),
        first_divergence: gone.iter().flatten().min().copied(),
    })
}
