//! Backward pass through a rollout: gradients of `-J` with respect to actions.

use nerd_tasks::{Compiled, View, Work};

use super::behind::{Behind, Env};
use super::frames::Frames;
use super::*;

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

/// Computes J and its gradients with respect to the actions of a rollout.
pub(super) fn back(
    steps: &Steps,
    episodes: &mut Episodes,
    policy: &Policy,
    value: &Policy,
    config: &PpoConfig,
) -> Result<Found> {
    let h = config.horizon;
    let Simulation { batch, solver } = &mut episodes.simulation;
    let mut frames = Frames::new(&mut **solver, batch.clone());
    let rollout = Rollout::new(steps, &episodes.task, batch, policy, config);
    let Rollout { n, a, .. } = rollout;
    let mut behind = Behind::new(&batch.system, n, a);
    let (actor, critic) = (policy.network(), value.network());
    let mut by_actions = vec![0.0; h * n * a];
    let mut earned = 0.0;
    let mut cut = steps.cut.len() / rollout.width;
    for t in (0..h).rev() {
        cut -= rollout.ends(t).iter().filter(|end| **end == TRUNCATED).count();
        let asked = rollout.asked(t);
        let (by_rows, worth) = rollout.back_through_value(t, &asked, cut, (value, &critic));
        earned += worth;
        earned += rollout.rewarded(t);
        frames.lost.iter_mut().enumerate().for_each(|(env, lost)| *lost = rollout.reached(t, env)[0].is_nan());
        behind.each(|env, by, work| {
            let by_row = asked.binary_search(&env).ok().map(|i| &by_rows[i * rollout.width..][..rollout.width]);
            rollout.back_through_end(t, env, by_row, by, work);
        });
        rollout.back_through_frames(t, &mut frames, &mut behind)?;
        rollout.hold_back(t, &mut behind.by_action);
        rollout.back_through_policy(t, (policy, &actor), &mut behind);
        behind.exclude(&mut frames.without);
        by_actions[t * n * a..][..n * a].copy_from_slice(&behind.by_action);
    }
    let without = (0..n).filter(|env| frames.without[*env]).collect_vec();
    for (t, env) in (0..h).flat_map(|t| without.iter().map(move |env| (t, env))) {
        by_actions[(t * n + env) * a..][..a].fill(0.0);
    }
    Ok(Found { by_actions, earned, without })
}

/// A rollout, as input of its backward pass.
struct Rollout<'a> {
    steps: &'a Steps,
    task: &'a Compiled,
    scenes: &'a [Arc<Scene>],
    config: &'a PpoConfig,
    /// Weights of rewards in J, and the factor on all of them.
    shares: Vec<f64>,
    scale: f64,
    /// Environments, frames in a step; widths of a state, torques, an action, a stacked observation and a goal.
    n: usize,
    frames: usize,
    d: usize,
    joints: usize,
    a: usize,
    width: usize,
    goals: usize,
}

impl<'a> Rollout<'a> {
    fn new(steps: &'a Steps, task: &'a Compiled, batch: &'a Batch, policy: &Policy, config: &'a PpoConfig) -> Self {
        let n = batch.len();
        let robot = &batch.system.robot;
        Self {
            steps,
            task,
            scenes: &batch.scenes,
            config,
            shares: shares(&steps.ends, n, config.gamma),
            scale: 1.0 / config.steps() as f64,
            n,
            frames: task.frames() as usize,
            d: robot.state_dim(),
            joints: robot.joint_count(),
            a: policy.shape.action,
            width: policy.shape.inputs(),
            goals: task.goal_dim(),
        }
    }

    fn ends(&self, t: usize) -> &[u8] {
        &self.steps.ends[t * self.n..][..self.n]
    }

    /// Sampled actions of a step.
    fn drawn(&self, t: usize) -> &[f32] {
        &self.steps.drawn[t * self.n * self.a..][..self.n * self.a]
    }

    /// State after a step, before an episode's restart.
    fn reached(&self, t: usize, env: usize) -> &[f64] {
        &self.steps.trace.reached[(t * self.n + env) * self.d..][..self.d]
    }

    /// What the task sees before frame k.
    fn seen(&self, k: usize, env: usize) -> View<'_> {
        let trace = &self.steps.trace;
        let goal = &trace.goals[(k * self.n + env) * self.goals..][..self.goals];
        View { state: &trace.states[(k * self.n + env) * self.d..][..self.d], goal, scene: &self.scenes[env] }
    }

    /// Environments with a bootstrap value after this step.
    fn asked(&self, t: usize) -> Vec<usize> {
        let ends = self.ends(t);
        let last = t + 1 == self.config.horizon;
        (0..self.n).filter(|env| ends[*env] == TRUNCATED || (last && ends[*env] == 0)).collect()
    }

    /// Observations of the environments `asked` after a step; `cut`: the step's first index in `steps.cut`.
    fn rows_after(&self, t: usize, asked: &[usize], cut: usize) -> Vec<f64> {
        let Self { steps, n, width, .. } = *self;
        let ends = self.ends(t);
        let mut next_cut = cut;
        let mut rows = Vec::with_capacity(asked.len() * width);
        for env in asked {
            let row = if ends[*env] == TRUNCATED {
                &steps.cut[next_cut * width..]
            } else {
                &steps.rows[((t + 1) * n + env) * width..]
            };
            next_cut += usize::from(ends[*env] == TRUNCATED);
            rows.extend_from_slice(&row[..width]);
        }
        rows
    }

    /// Gradients with respect to the observations of the environments `asked`, through their bootstrap values. Also
    /// returns the contribution of these values to J.
    fn back_through_value(
        &self,
        t: usize,
        asked: &[usize],
        cut: usize,
        (value, critic): (&Policy, &Loaded),
    ) -> (Vec<f64>, f64) {
        let rows = self.rows_after(t, asked, cut);
        let later = |i: usize| self.config.gamma * self.shares[t * self.n + asked[i]] * self.scale;
        let unit = value.returns.scale(0);
        through(value, critic, &rows, By::Rows, |i, said, by| {
            by[self.a] = (-later(i) * unit) as f32;
            later(i) * value.returns.restore(0, f64::from(said[self.a]))
        })
    }

    /// Contribution of a step's rewards to J.
    fn rewarded(&self, t: usize) -> f64 {
        let Self { steps, n, scale, .. } = *self;
        (0..n).map(|env| scale * self.shares[t * n + env] * steps.rewards[t * n + env]).sum()
    }

    /// Begins a step's backward pass in one environment: through the reward, and the next observation where `by_row`
    /// is given.
    fn back_through_end(&self, t: usize, env: usize, by_row: Option<&[f64]>, by: Env, work: &mut Work) {
        let Env { gradient, by_torques, by_action } = by;
        let Self { steps, task, n, joints, .. } = *self;
        let last = (t + 1) * self.frames - 1;
        by_torques.fill(0.0);
        by_action.fill(0.0);
        if self.ends(t)[env] > 0 {
            gradient.fill(0.0);
        }
        let state = self.reached(t, env);
        if state[0].is_nan() {
            return;
        }
        // The goal after the step.
        let mut goal = self.seen(last, env).goal.to_vec();
        task.advance(&mut goal);
        task.remember(&mut goal, &numbers(&self.drawn(t)[env * self.a..][..self.a]));
        let view = View { state, goal: &goal, ..self.seen(last, env) };
        let torques = &steps.trace.torques[(last * n + env) * joints..][..joints];
        task.reward_back(view, torques, work, -self.scale * self.shares[t * n + env], gradient, by_torques);
        if let Some(by_row) = by_row {
            task.observe_back(view, work, by_row, gradient);
        }
    }

    /// Goes through a step's frames, from the last to the first: solver, then torques of the action.
    fn back_through_frames(&self, t: usize, frames: &mut Frames, behind: &mut Behind) -> Result<()> {
        let Self { steps: Steps { trace, .. }, n, d, joints, a, .. } = *self;
        let drawn = self.drawn(t);
        for k in (t * self.frames..(t + 1) * self.frames).rev() {
            let states = &trace.states[k * n * d..][..n * d];
            let torques = &trace.torques[k * n * joints..][..n * joints];
            let found = frames.step_back(states, torques, &mut behind.by_states)?;
            add(&mut behind.by_torques, &found);
            behind.each(|env, Env { gradient, by_torques, by_action }, work| {
                let action = numbers(&drawn[env * a..][..a]);
                self.task.act_back(self.seen(k, env), &action, work, by_torques, gradient, by_action);
                by_torques.fill(0.0);
            });
        }
        Ok(())
    }

    /// For an action beyond a bound, sets a gradient that would push the action further out to 0.
    fn hold_back(&self, t: usize, by_action: &mut [f64]) {
        by_action
            .iter_mut()
            .zip(self.drawn(t))
            .filter(|(g, a)| a.abs() > 1.0 && **g * f64::from(**a) < 0.0)
            .for_each(|(g, _)| *g = 0.0);
    }

    /// Adds the gradient with respect to the state before a step, through observation and mean action.
    fn back_through_policy(&self, t: usize, (policy, actor): (&Policy, &Loaded), behind: &mut Behind) {
        let Self { n, a, width, .. } = *self;
        let rows = &self.steps.rows[t * n * width..][..n * width];
        let by_action = &behind.by_action;
        let (by_rows, _) = through(policy, actor, rows, By::Rows, |i, _, by| {
            by[..a].iter_mut().zip(&by_action[i * a..]).for_each(|(by, g)| *by = *g as f32);
            0.0
        });
        behind.each(|env, Env { gradient, .. }, work| {
            let view = self.seen(t * self.frames, env);
            self.task.observe_back(view, work, &by_rows[env * width..][..width], gradient);
        });
    }
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
