//! Backward pass through a rollout: gradients of `-J` with respect to actions.

use nerd_tasks::{View, Work};

use super::*;

/// Environments in one parallel chunk.
const ROWS: usize = 64;

/// Result of the backward pass.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    /// Gradients of `-J` with respect to sampled actions, `[step][env][action]`.
    pub by_actions: Vec<f64>,
    /// The objective J of the rollout.
    pub earned: f64,
    /// Environments with a frame without finite gradients; all their gradients are 0.
    pub without: Vec<usize>,
}

/// Gradients of one environment with respect to its state, torques and action.
struct Env<'a> {
    gradient: &'a mut [f64],
    by_torques: &'a mut [f64],
    by_action: &'a mut [f64],
}

/// Backward pass through the solver's frames.
struct Frames<'a> {
    solver: &'a mut dyn Solver,
    batch: Batch,
    torques: Vec<f64>,
    /// `without`: environments with a frame that has no gradients. `lost`: environments that failed in the present
    /// step, so that it has no gradient.
    without: Vec<bool>,
    lost: Vec<bool>,
}

impl Frames<'_> {
    /// Replaces `behind`, gradients with respect to the states after a frame, by gradients with respect to the states
    /// before it. Returns gradients with respect to torques. In place of an excluded environment, the solver steps a
    /// copy of another one.
    fn back(&mut self, states: &[f64], torques: &[f64], behind: &mut Vec<f64>) -> Result<Vec<f64>> {
        let n = self.batch.len();
        let robot = &self.batch.system.robot;
        let d = robot.state_dim();
        let joints = robot.joint_count();
        let wide = 2 * robot.nv();
        loop {
            let gone = |env: usize| self.without[env] || self.lost[env];
            let Some(sound) = (0..n).find(|env| !gone(*env)) else {
                behind.fill(0.0);
                return Ok(vec![0.0; n * joints]);
            };
            self.batch.states.copy_from_slice(states);
            torques.clone_into(&mut self.torques);
            for env in (0..n).filter(|env| gone(*env)) {
                self.batch.states[env * d..][..d].copy_from_slice(&states[sound * d..][..d]);
                self.torques[env * joints..][..joints].copy_from_slice(&torques[sound * joints..][..joints]);
                behind[env * wide..][..wide].fill(0.0);
            }
            match self.solver.vjp(&self.batch, &self.torques, 1, behind) {
                Ok(found) => {
                    *behind = found.states;
                    return Ok(found.torques);
                }
                Err(error) => {
                    let faults = error.faults()?;
                    if faults.iter().all(|fault| gone(fault.env)) {
                        return Err(StepError::Environments(faults).into());
                    }
                    faults.iter().for_each(|fault| self.without[fault.env] = true);
                }
            }
        }
    }
}

/// Computes J and its gradients with respect to the actions of a rollout.
pub(super) fn back(
    steps: &Steps,
    episodes: &mut Episodes,
    policy: &Policy,
    value: &Policy,
    config: &PpoConfig,
) -> Result<Found> {
    let n = episodes.len();
    let h = config.horizon;
    let frames = episodes.task.frames() as usize;
    let task = &episodes.task;
    let scale = 1.0 / config.steps() as f64;
    let Simulation { batch: now, solver } = &mut episodes.simulation;
    let batch = now.clone();
    let system = now.system.clone();
    let mut way =
        Frames { solver: &mut **solver, batch, torques: Vec::new(), without: vec![false; n], lost: vec![false; n] };
    let d = system.robot.state_dim();
    let joints = system.robot.joint_count();
    let wide = 2 * system.robot.nv();
    let width = policy.shape.inputs();
    let a = policy.shape.action;
    let goals = task.goal_dim();
    let (actor, critic) = (policy.network(), value.network());
    let shares = shares(&steps.ends, n, config.gamma);
    let trace = &steps.trace;
    let (mut behind, mut by_torques, mut by_action) = (vec![0.0; n * wide], vec![0.0; n * joints], vec![0.0; n * a]);
    let mut works = (0..n.div_ceil(ROWS)).map(|_| Work::new(&system)).collect_vec();
    let mut by_actions = vec![0.0; h * n * a];
    let mut earned = 0.0;
    let mut cut = steps.cut.len() / width;
    let mut each = |parts: (&mut [f64], &mut [f64], &mut [f64]), one: &(dyn Fn(usize, Env, &mut Work) + Sync)| {
        let (gradients, torques, actions) = parts;
        let chunks = gradients
            .par_chunks_mut(ROWS * wide)
            .zip(torques.par_chunks_mut(ROWS * joints))
            .zip(actions.par_chunks_mut(ROWS * a));
        chunks.zip(&mut works).enumerate().for_each(|(chunk, (((gradients, torques), actions), work))| {
            let rows =
                gradients.chunks_exact_mut(wide).zip(torques.chunks_exact_mut(joints)).zip(actions.chunks_exact_mut(a));
            for (i, ((gradient, by_torques), by_action)) in rows.enumerate() {
                one(chunk * ROWS + i, Env { gradient, by_torques, by_action }, work);
            }
        });
    };
    let scenes = &now.scenes;
    let seen = |k: usize, env: usize| {
        let goal = &trace.goals[(k * n + env) * goals..][..goals];
        View { state: &trace.states[(k * n + env) * d..][..d], goal, scene: &scenes[env] }
    };
    for t in (0..h).rev() {
        let ends = &steps.ends[t * n..][..n];
        let last = (t + 1) * frames - 1;
        // Environments with a bootstrap value after this step.
        let asked = (0..n).filter(|env| ends[*env] == TRUNCATED || (t + 1 == h && ends[*env] == 0)).collect_vec();
        cut -= ends.iter().filter(|end| **end == TRUNCATED).count();
        let mut next_cut = cut;
        let mut rows = Vec::with_capacity(asked.len() * width);
        for env in &asked {
            let row = if ends[*env] == TRUNCATED {
                &steps.cut[next_cut * width..]
            } else {
                &steps.rows[((t + 1) * n + env) * width..]
            };
            next_cut += usize::from(ends[*env] == TRUNCATED);
            rows.extend_from_slice(&row[..width]);
        }
        let later = |i: usize| config.gamma * shares[t * n + asked[i]] * scale;
        let unit = value.returns.scale(0);
        let (by_rows, worth) = through(value, &critic, &rows, By::Rows, |i, said, by| {
            by[a] = (-later(i) * unit) as f32;
            later(i) * value.returns.restore(0, f64::from(said[a]))
        });
        earned += worth;
        earned += (0..n).map(|env| scale * shares[t * n + env] * steps.rewards[t * n + env]).sum::<f64>();
        let reached = |env: usize| &trace.reached[(t * n + env) * d..][..d];
        way.lost.iter_mut().enumerate().for_each(|(env, lost)| *lost = reached(env)[0].is_nan());
        each((&mut behind, &mut by_torques, &mut by_action), &|env, Env { gradient, by_torques, by_action }, work| {
            by_torques.fill(0.0);
            by_action.fill(0.0);
            if ends[env] > 0 {
                gradient.fill(0.0);
            }
            let state = reached(env);
            if state[0].is_nan() {
                return;
            }
            // The goal after the step.
            let mut goal = seen(last, env).goal.to_vec();
            task.advance(&mut goal);
            task.remember(&mut goal, &numbers(&steps.drawn[(t * n + env) * a..][..a]));
            let view = View { state, goal: &goal, ..seen(last, env) };
            let torques = &trace.torques[(last * n + env) * joints..][..joints];
            task.reward_back(view, torques, work, -scale * shares[t * n + env], gradient, by_torques);
            if let Ok(i) = asked.binary_search(&env) {
                task.observe_back(view, work, &by_rows[i * width..][..width], gradient);
            }
        });
        let drawn = &steps.drawn[t * n * a..][..n * a];
        for k in (t * frames..=last).rev() {
            let found = way.back(
                &trace.states[k * n * d..][..n * d],
                &trace.torques[k * n * joints..][..n * joints],
                &mut behind,
            )?;
            add(&mut by_torques, &found);
            each(
                (&mut behind, &mut by_torques, &mut by_action),
                &|env, Env { gradient, by_torques, by_action }, work| {
                    task.act_back(
                        seen(k, env),
                        &numbers(&drawn[env * a..][..a]),
                        work,
                        by_torques,
                        gradient,
                        by_action,
                    );
                    by_torques.fill(0.0);
                },
            );
        }
        // For an action beyond a bound, set a gradient that would push the action further out to 0.
        by_action
            .iter_mut()
            .zip(drawn)
            .filter(|(g, a)| a.abs() > 1.0 && **g * f64::from(**a) < 0.0)
            .for_each(|(g, _)| *g = 0.0);
        let (by_rows, _) = through(policy, &actor, &steps.rows[t * n * width..][..n * width], By::Rows, |i, _, by| {
            by[..a].iter_mut().zip(&by_action[i * a..]).for_each(|(by, g)| *by = *g as f32);
            0.0
        });
        each((&mut behind, &mut by_torques, &mut by_action), &|env, Env { gradient, .. }, work| {
            task.observe_back(seen(t * frames, env), work, &by_rows[env * width..][..width], gradient);
        });
        for env in 0..n {
            let own = [&mut behind[env * wide..][..wide], &mut by_action[env * a..][..a]];
            if !own.iter().all(|numbers| numbers.iter().all(|g| g.is_finite())) {
                way.without[env] = true;
                own.into_iter().for_each(|numbers| numbers.fill(0.0));
            }
        }
        by_actions[t * n * a..][..n * a].copy_from_slice(&by_action);
    }
    let without = (0..n).filter(|env| way.without[*env]).collect_vec();
    for (t, env) in (0..h).flat_map(|t| without.iter().map(move |env| (t, env))) {
        by_actions[(t * n + env) * a..][..a].fill(0.0);
    }
    Ok(Found { by_actions, earned, without })
}

fn numbers(x: &[f32]) -> Vec<f64> {
    x.iter().map(|x| f64::from(*x)).collect()
}

/// Weight of each step's reward in J, `[step][env]`: powers of gamma, from 1 at the start of the rollout or episode.
fn shares(ends: &[u8], n: usize, gamma: f64) -> Vec<f64> {
    let mut out = vec![1.0; ends.len()];
    for i in n..out.len() {
        out[i] = if ends[i - n] > 0 { 1.0 } else { gamma * out[i - n] };
    }
    out
}
