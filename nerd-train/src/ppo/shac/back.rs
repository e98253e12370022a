//! The way back through a rollout.

use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_sim::prelude::*;
use nerd_tasks::{Episodes, View, Work};
use rayon::prelude::*;

use super::steps::Steps;
use crate::error::Result;
use crate::ppo::{Policy, PpoConfig, TRUNCATED};

/// Rows that one thread takes at a time.
const ROWS: usize = 64;

/// Gradients through a network of rows as they are seen: by its parameters, and by the rows; and the sum of what `say` says of a row's outputs
/// when it writes the gradient by them. All are summed in order.
pub(super) fn through(
    policy: &Policy,
    network: &Loaded,
    rows: &[f64],
    say: impl Fn(usize, &[f32], &mut [f32]) -> f64 + Sync,
) -> (Vec<f32>, Vec<f64>, f64) {
    let (width, outputs) = (policy.shape.inputs(), policy.shape.outputs());
    let part = |(first, rows): (usize, &[f64])| {
        let (mut inputs, mut memory) = (Vec::new(), Memory::default());
        policy.seen.rows(rows, &mut inputs);
        let said = network.forward(&inputs, &mut memory, Pass::Kept(1)).clone();
        let mut by = vec![0.0; said.len()];
        let both = said.chunks_exact(outputs).zip(by.chunks_exact_mut(outputs)).enumerate();
        let sum: f64 = both.map(|(i, (said, by))| say(first * ROWS + i, said, by)).sum();
        let (flat, by_inputs) = network.backward(1, &by, &mut memory, true);
        let by_row = by_inputs.iter().enumerate().map(|(i, g)| policy.seen.slope(i % width, rows[i]) * f64::from(*g));
        (flat, by_row.collect::<Vec<_>>(), sum)
    };
    let parts: Vec<_> = rows.par_chunks(ROWS * width).enumerate().map(part).collect();
    let mut flat = vec![0.0; policy.flat.len()];
    parts.iter().for_each(|(part, ..)| flat.iter_mut().zip(part).for_each(|(sum, g)| *sum += g));
    let sum = parts.iter().map(|part| part.2).sum();
    (flat, parts.into_iter().flat_map(|part| part.1).collect(), sum)
}

/// What one environment's thread works on: gradients by its state, by its torques and by its action.
struct Env<'a> {
    slope: &'a mut [f64],
    by_torques: &'a mut [f64],
    by_action: &'a mut [f64],
}

/// Gradient of `-J` by the policy's parameters, and J; of `all` environments these are some.
pub(super) fn gradient(
    steps: &Steps,
    episodes: &mut Episodes,
    policy: &Policy,
    value: &Policy,
    config: &PpoConfig,
    all: usize,
) -> Result<(Vec<f32>, f64)> {
    let (n, h, frames) = (episodes.len(), config.horizon, episodes.task.frames() as usize);
    let (task, scale) = (&*episodes.task, 1.0 / (all * h) as f64);
    let Simulation { batch: now, solver } = &mut episodes.simulation;
    let (mut batch, system) = (now.clone(), now.system.clone());
    let (d, joints, wide) = (system.robot.state_dim(), system.robot.joint_count(), 2 * system.robot.nv());
    let (width, a, goals) = (policy.shape.inputs(), policy.shape.action, task.goal_dim());
    let (actor, critic) = (policy.network(), value.network());
    let Some(slopes) = task.slopes() else { return Ok((Vec::new(), 0.0)) };
    let (shares, trace) = (shares(&steps.ends, n, config.gamma), &steps.trace);
    let (mut behind, mut by_torques, mut by_action) = (vec![0.0; n * wide], vec![0.0; n * joints], vec![0.0; n * a]);
    let mut works: Vec<Work> = (0..n.div_ceil(ROWS)).map(|_| Work::new(&system)).collect();
    let (mut flat, mut earned, mut cut) = (vec![0.0f32; policy.flat.len()], 0.0, steps.cut.len() / width);
    let mut each = |parts: (&mut [f64], &mut [f64], &mut [f64]), one: &(dyn Fn(usize, Env, &mut Work) + Sync)| {
        let (slopes, torques, actions) = parts;
        let chunks = slopes.par_chunks_mut(ROWS * wide).zip(torques.par_chunks_mut(ROWS * joints)).zip(actions.par_chunks_mut(ROWS * a));
        chunks.zip(&mut works).enumerate().for_each(|(chunk, (((slopes, torques), actions), work))| {
            let rows = slopes.chunks_exact_mut(wide).zip(torques.chunks_exact_mut(joints)).zip(actions.chunks_exact_mut(a));
            for (i, ((slope, by_torques), by_action)) in rows.enumerate() {
                one(chunk * ROWS + i, Env { slope, by_torques, by_action }, work);
            }
        });
    };
    let scenes = &now.scenes;
    let seen = |k: usize, env: usize| {
        let goal = &trace.goals[(k * n + env) * goals..][..goals];
        View { state: &trace.states[(k * n + env) * d..][..d], goal, scene: &scenes[env] }
    };
    for t in (0..h).rev() {
        let (ends, last) = (&steps.ends[t * n..][..n], (t + 1) * frames - 1);
        // States whose value stands for what comes after them.
        let asked: Vec<usize> = (0..n).filter(|env| ends[*env] == TRUNCATED || (t + 1 == h && ends[*env] == 0)).collect();
        cut -= ends.iter().filter(|end| **end == TRUNCATED).count();
        let mut next_cut = cut;
        let mut rows = Vec::with_capacity(asked.len() * width);
        for env in &asked {
            let row = if ends[*env] == TRUNCATED { &steps.cut[next_cut * width..] } else { &steps.rows[((t + 1) * n + env) * width..] };
            next_cut += usize::from(ends[*env] == TRUNCATED);
            rows.extend_from_slice(&row[..width]);
        }
        let later = |i: usize| config.gamma * shares[t * n + asked[i]] * scale;
        let unit = value.returns.scale(0);
        let (_, by_rows, worth) = through(value, &critic, &rows, |i, said, by| {
            by[a] = (-later(i) * unit) as f32;
            later(i) * value.returns.restore(0, f64::from(said[a]))
        });
        earned += worth;
        earned += (0..n).map(|env| scale * shares[t * n + env] * steps.rewards[t * n + env]).sum::<f64>();
        each((&mut behind, &mut by_torques, &mut by_action), &|env, Env { slope, by_torques, by_action }, work| {
            by_torques.fill(0.0);
            by_action.fill(0.0);
            if ends[env] > 0 {
                slope.fill(0.0);
            }
            let state = &trace.reached[(t * n + env) * d..][..d];
            if state[0].is_nan() {
                return;
            }
            let view = View { state, ..seen(last, env) };
            let torques = &trace.torques[(last * n + env) * joints..][..joints];
            slopes.reward_back(view, torques, work, -scale * shares[t * n + env], slope, by_torques);
            if let Ok(i) = asked.binary_search(&env) {
                slopes.observe_back(view, work, &by_rows[i * width..][..width], slope);
            }
        });
        let drawn = &steps.drawn[t * n * a..][..n * a];
        for k in (t * frames..=last).rev() {
            batch.states.copy_from_slice(&trace.states[k * n * d..][..n * d]);
            let found = solver.back(&batch, &trace.torques[k * n * joints..][..n * joints], 1, &behind)?;
            behind = found.states;
            by_torques.iter_mut().zip(found.torques).for_each(|(sum, g)| *sum += g);
            each((&mut behind, &mut by_torques, &mut by_action), &|env, Env { slope, by_torques, by_action }, work| {
                let action: Vec<f64> = drawn[env * a..][..a].iter().map(|x| f64::from(*x)).collect();
                slopes.act_back(seen(k, env), &action, work, by_torques, slope, by_action);
                by_torques.fill(0.0);
            });
        }
        // At a bound what leads outside ends.
        by_action.iter_mut().zip(drawn).filter(|(g, a)| a.abs() > 1.0 && **g * f64::from(**a) < 0.0).for_each(|(g, _)| *g = 0.0);
        let rows = &steps.rows[t * n * width..][..n * width];
        let say = |i: usize, _: &[f32], by: &mut [f32]| {
            by[..a].iter_mut().zip(&by_action[i * a..]).for_each(|(by, g)| *by = *g as f32);
            0.0
        };
        let (own, by_rows, _) = through(policy, &actor, rows, say);
        flat.iter_mut().zip(own).for_each(|(sum, g)| *sum += g);
        let spread = flat.len() - a;
        for ((i, g), (drawn, mean)) in by_action.iter().enumerate().zip(drawn.iter().zip(&steps.mean[t * n * a..])) {
            flat[spread + i % a] += (g * f64::from(drawn - mean)) as f32;
        }
        each((&mut behind, &mut by_torques, &mut by_action), &|env, Env { slope, .. }, work| {
            slopes.observe_back(seen(t * frames, env), work, &by_rows[env * width..][..width], slope);
            // Of what strikes too hard nothing is learned.
            if slope.iter().any(|g| !g.is_finite()) {
                slope.fill(0.0);
            }
        });
    }
    Ok((flat, earned))
}

/// What each step's reward counts, `[step][env]`: less from step to step, all of it again where an episode begins.
fn shares(ends: &[u8], n: usize, gamma: f64) -> Vec<f64> {
    let mut out = vec![1.0; ends.len()];
    for i in n..out.len() {
        out[i] = if ends[i - n] > 0 { 1.0 } else { gamma * out[i - n] };
    }
    out
}
