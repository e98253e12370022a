//! Slopes of a frame against central differences, on states that random torques visit.

use std::sync::Arc;

use nerd_core::tangent::{difference, moved};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use rand::RngExt;

use super::common::*;

/// Solves of a substep until no drag changes any more, or so many: differences do not see what repetition left.
const SOLVES: usize = 300;
const SETTLED: f64 = 1e-13;
/// Largest error of a column of slopes, against its size.
const EXACT: f64 = 1e-6;

fn settled(substeps: usize) -> Articulated {
    implicit(substeps).settling(SETTLED, SOLVES)
}

/// Random torques of every joint of so many environments.
fn pushed(system: &System, envs: usize, random: &mut impl RngExt) -> Vec<f64> {
    let amplitudes = system.torque_amplitudes();
    (0..envs).flat_map(|_| &amplitudes).map(|a| a * random.random_range(-1.0..=1.0)).collect()
}

/// A batch at its starts for evaluation.
fn begun(system: &Arc<System>, scene: &str, envs: usize) -> Batch {
    let mut batch = batch(system, scene, envs);
    (0..envs).for_each(|env| batch.reset(env, &start(system, Start::Reset, &mut stream(0, env as u64))));
    batch
}

fn stepped(solver: &mut Articulated, system: &Arc<System>, scene: &str, state: &[f64], torques: &[f64]) -> Vec<f64> {
    let mut now = at(system, scene, state);
    solver.step(&mut now, torques).expect("steps");
    now.states
}

fn norm(x: impl IntoIterator<Item = f64>) -> f64 {
    x.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The difference of two columns against the size of the second.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    norm(a.iter().zip(b).map(|(a, b)| a - b)) / norm(b.iter().copied()).max(1e-12)
}

/// Central differences of the size that agrees best with the one before it, from `size` down, and how well they agree. Where something
/// changes within reach of them all, none do.
fn central(size: f64, mut side: impl FnMut(f64) -> Vec<f64>) -> (Vec<f64>, f64) {
    let mut of = |size: f64| side(size).iter().zip(side(-size)).map(|(a, b)| (a - b) / (2.0 * size)).collect::<Vec<f64>>();
    let (mut best, mut last) = ((Vec::new(), f64::INFINITY), of(size));
    for finer in 1..8 {
        let now = of(size * 0.25f64.powi(finer));
        let agrees = apart(&now, &last);
        if agrees < best.1 {
            best = (now.clone(), agrees);
        }
        last = now;
    }
    best
}

/// The worst error of a state's slopes, or none where differences disagree among themselves or the solves of a substep have no end.
fn error(solver: &mut Articulated, system: &Arc<System>, scene: &str, substeps: usize, state: &[f64], torques: &[f64]) -> Option<f64> {
    let robot = &system.robot;
    let (rows, joints) = (2 * robot.nv(), robot.joint_count());
    let identity: Vec<f64> = (0..rows * rows).map(|k| f64::from(k % (rows + 1) == 0)).collect();
    let slopes = solver.back(&at(system, scene, state), torques, rows, &identity).expect("slopes");
    let next = stepped(solver, system, scene, state, torques);
    assert_eq!(next, slopes.next, "not the frame that a step makes");
    let longer = stepped(&mut implicit(substeps).settling(SETTLED, SOLVES + 1), system, scene, state, torques);
    if apart(&longer, &next) > 1e-12 {
        return None;
    }
    let mut worst = 0.0f64;
    for k in 0..rows + joints {
        // Torques do less, and in proportion.
        let (found, agrees) = central(if k < rows { 3e-5 } else { 3e-2 }, |by| {
            let (mut from, mut torques) = (state.to_vec(), torques.to_vec());
            if k < rows {
                let change: Vec<f64> = (0..rows).map(|i| if i == k { by } else { 0.0 }).collect();
                moved(robot, state, &change, &mut from);
            } else {
                torques[k - rows] += by;
            }
            difference(robot, &next, &stepped(solver, system, scene, &from, &torques))
        });
        let own = |row: usize| if k < rows { slopes.states[row * rows + k] } else { slopes.torques[row * joints + k - rows] };
        if agrees > EXACT {
            return None;
        }
        worst = worst.max(apart(&(0..rows).map(own).collect::<Vec<_>>(), &found));
    }
    Some(worst)
}

#[test]
fn slopes_of_a_frame_are_those_of_central_differences() {
    let cases = [
        ("cube", "ground", 4),
        ("ant", "ground", 4),
        ("anymal", "ground", 4),
        ("pendulum", "ground1", 4),
        ("pendulum", "free", 4),
        ("cartpole", "free", 4),
        ("franka", "free", 4),
        ("ant", "free", 4),
    ];
    for (name, scene, substeps) in cases {
        let (system, mut solver, mut random) = (built_in(name), settled(substeps), stream(1, 0));
        let mut batch = begun(&system, scene, 4);
        let (mut errors, mut left_out) = (Vec::new(), 0);
        for frame in 0..100 {
            let torques = pushed(&system, batch.len(), &mut random);
            let joints = system.robot.joint_count();
            for env in (0..batch.len()).filter(|_| frame % 10 == 0) {
                let torques = &torques[env * joints..(env + 1) * joints];
                match error(&mut solver, &system, scene, substeps, batch.state(env), torques) {
                    Some(error) => errors.push(error),
                    None => left_out += 1,
                }
            }
            solver.step(&mut batch, &torques).expect("steps");
        }
        errors.sort_by(f64::total_cmp);
        let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
        println!(
            "{name}, {scene}: {} states, {left_out} left out, error {median:.1e} (median), {worst:.1e} (worst)",
            errors.len() + left_out
        );
        assert!(worst < EXACT && 20 * left_out <= errors.len() + left_out, "{name}, {scene}");
    }
}

/// Random numbers between -1 and 1.
fn direction(n: usize, random: &mut impl RngExt) -> Vec<f64> {
    (0..n).map(|_| random.random_range(-1.0..=1.0)).collect()
}

#[test]
fn slopes_of_a_rollout_are_products_of_those_of_its_frames() {
    const FRAMES: usize = 32;
    for (name, scene) in [("cartpole", "free"), ("pendulum", "ground1"), ("ant", "ground"), ("anymal", "ground")] {
        let (system, mut solver, mut random) = (built_in(name), settled(4), stream(2, 0));
        let robot = &system.robot;
        let (rows, joints, envs) = (2 * robot.nv(), robot.joint_count(), 20);
        let pushes: Vec<Vec<f64>> = (0..FRAMES).map(|_| pushed(&system, envs, &mut random)).collect();
        let mut batches = vec![begun(&system, scene, envs)];
        for torques in &pushes {
            let mut next = batches[batches.len() - 1].clone();
            solver.step(&mut next, torques).expect("steps");
            batches.push(next);
        }
        // Of a random sum of the last state, by the first state and all torques along random directions, in one batch.
        let by_last = direction(envs * rows, &mut random);
        let along = direction(envs * rows, &mut random);
        let along_torques: Vec<Vec<f64>> = (0..FRAMES).map(|_| direction(envs * joints, &mut random)).collect();
        let (mut by_state, mut found) = (by_last.clone(), vec![0.0; envs]);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for ((batch, torques), along) in batches.iter().zip(&pushes).zip(&along_torques).rev() {
            let slopes = solver.back(batch, torques, 1, &by_state).expect("slopes");
            (0..envs).for_each(|e| found[e] += dot(&slopes.torques[e * joints..][..joints], &along[e * joints..][..joints]));
            by_state = slopes.states;
        }
        (0..envs).for_each(|e| found[e] += dot(&by_state[e * rows..][..rows], &along[e * rows..][..rows]));
        let mut errors: Vec<f64> = (0..envs)
            .map(|e| {
                let last = batches[FRAMES].state(e);
                let (expected, _) = central(3e-6, |by| {
                    let mut state = batches[0].state(e).to_vec();
                    let change: Vec<f64> = along[e * rows..][..rows].iter().map(|x| x * by).collect();
                    moved(robot, batches[0].state(e), &change, &mut state);
                    for (torques, along) in pushes.iter().zip(&along_torques) {
                        let torques = torques.iter().zip(along).map(|(t, a)| t + a * by);
                        let torques: Vec<f64> = torques.skip(e * joints).take(joints).collect();
                        state = stepped(&mut solver, &system, scene, &state, &torques);
                    }
                    vec![dot(&difference(robot, last, &state), &by_last[e * rows..][..rows])]
                });
                apart(&[found[e]], &expected)
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        let (median, most) = (errors[envs / 2], errors[envs * 9 / 10 - 1]);
        println!("{name}, {scene}: error of {FRAMES} frames {median:.1e} (median), {most:.1e} (nine of ten)");
        // Within 32 frames a foot of ANYmal's lands or parts so close to a substep's end that differences see it.
        assert!(median < EXACT && most < if name == "anymal" { 1e-2 } else { EXACT }, "{name}, {scene}");
    }
}
