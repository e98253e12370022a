//! Iterative LQR (Tassa, Erez and Todorov 2012, "Synthesis and stabilization of complex behaviors through online trajectory optimization")
//! on least squares: a task's residuals r and actions u of a plan are made small,
//!
//! ```text
//! J = sum over steps of (|r(x)|^2 + effort |u|^2) / 2
//! ```
//!
//! with `r' r` for its second derivative (Gauss-Newton), a linearised solver ([`nerd_sim::solver::Solver::linearise`]), regularisation by distance
//! from the states of the plan (their eq. 10 and 11), and a line search whose steps are rolled out beside each other. Actions are clamped to
//! [-1, 1]; one at its limit that its slope pushes further stays there, without feedback, in the spirit of Tassa, Mansard and Todorov 2014. Each
//! call first rolls out what the last one found, from where the environment is now, then linearises about the cheapest copy.

use nalgebra::{DMatrix, DVector};
use nerd_core::tangent::difference;
use nerd_sim::solver::StepError;

use super::Planner;
use super::ahead::Ahead;
use super::linear::{Step, linearise};
use crate::Episodes;

/// Settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IlqrConfig {
    /// Steps of a plan.
    pub steps: usize,
    /// Weight of squared actions beside squared residuals.
    pub effort: f64,
    /// Rounds of linearising and searching for each action, and for the first one of a plan.
    pub rounds: [usize; 2],
    /// Copies in a line search: of the step 1, 1/2, 1/4, and so on, the last of none.
    pub search: usize,
}

impl Default for IlqrConfig {
    fn default() -> Self {
        Self { steps: 48, effort: 0.01, rounds: [1, 10], search: 6 }
    }
}

/// Least and largest weight of distances from a plan's states, and its factor from round to round.
const DAMPING: [f64; 3] = [1e-6, 1e6, 4.0];

/// Cost of a step after which the episode is over: above that of any other.
const OVER: f64 = 1e6;

/// The planner.
pub struct Ilqr {
    ahead: Ahead,
    config: IlqrConfig,
    /// By environment.
    laws: Vec<Law>,
}

/// How a plan is changed and held on to.
#[derive(Default)]
struct Law {
    damping: f64,
    /// States before each step; empty of a plan that has not been rolled out.
    states: Vec<Vec<f64>>,
    /// By step a change of the action, and what it is changed by for a difference of the state, `[action][2 nv]`.
    gains: Vec<(DVector<f64>, DMatrix<f64>)>,
}

/// What was rolled out.
struct Rolled {
    /// By copy.
    costs: Vec<f64>,
    /// `[frame][copy][q, qd]`, the last after the last frame.
    states: Vec<Vec<f64>>,
    /// `[frame][copy][joint]`.
    torques: Vec<Vec<f64>>,
    /// `[step][copy][action]`.
    actions: Vec<Vec<f64>>,
}

impl Ilqr {
    /// Looks ahead in `episodes`, of which there are [`IlqrConfig::search`] for each environment that is planned for.
    ///
    /// # Errors
    /// If the task has no residuals ([`crate::formula::Formulas::residuals`]).
    pub fn new(mut episodes: Episodes, config: IlqrConfig) -> Result<Self, StepError> {
        if episodes.residuals(0).is_empty() {
            let why = format!("task `{}` has no residuals for a planner of least squares: plan it by MPPI", episodes.task.name());
            return Err(StepError::Refused(why));
        }
        Ok(Self { ahead: Ahead::new(episodes, config.search, config.steps), config, laws: Vec::new() })
    }

    /// Rolls every copy out, changed by its share of what the laws say.
    fn roll(&mut self) -> Result<Rolled, StepError> {
        let Ahead { episodes, copies, plans, .. } = &mut self.ahead;
        let (n, width, robot) = (episodes.len(), episodes.task.action_dim(), episodes.simulation.batch.system.clone());
        let (mut failed, mut costs) = (vec![false; n], vec![0.0; n]);
        let (mut states, mut torques, mut all) = (Vec::new(), Vec::new(), Vec::new());
        for step in 0..self.config.steps {
            let mut actions = Vec::with_capacity(n * width);
            for env in 0..n {
                let (of, copy) = (env / *copies, env % *copies);
                let planned = &plans[(of * self.config.steps + step) * width..][..width];
                let law = &self.laws[of];
                let share = if copy + 1 == *copies { 0.0 } else { 0.5_f64.powi(copy as i32) };
                let change = law.gains.get(step).map(|(change, gain)| {
                    let away = difference(&robot.robot, &law.states[step], episodes.simulation.batch.state(env));
                    change * share + gain * DVector::from_vec(away)
                });
                let changed = |k: usize| planned[k] + change.as_ref().map_or(0.0, |change| change[k]);
                actions.extend((0..width).map(|k| changed(k).clamp(-1.0, 1.0)));
            }
            for _ in 0..episodes.task.frames() {
                states.push(episodes.simulation.batch.states.clone());
                torques.push(episodes.act(&actions).to_vec());
                episodes.frame(&mut failed)?;
            }
            episodes.done(&actions);
            for (env, cost) in costs.iter_mut().enumerate() {
                let squares: f64 = episodes.residuals(env).iter().map(|r| r * r).sum();
                let effort: f64 = actions[env * width..][..width].iter().map(|u| self.config.effort * u * u).sum();
                let own = 0.5 * (squares + effort);
                // What is no number costs the most, too.
                *cost += if !failed[env] && own < OVER && !episodes.over(env) { own } else { OVER };
            }
            all.push(actions);
        }
        states.push(episodes.simulation.batch.states.clone());
        Ok(Rolled { costs, states, torques, actions: all })
    }

    /// Takes the cheapest copy of each of some environments for its plan, and finds how to change that.
    fn round(&mut self, present: &Episodes, envs: &[usize]) -> Result<(), StepError> {
        self.ahead.place(present)?;
        let rolled = self.roll()?;
        let (copies, size, robot) = (self.config.search, self.ahead.size(), present.simulation.batch.system.clone());
        let (width, d, joints) = (size / self.config.steps, robot.robot.state_dim(), robot.robot.joint_count());
        let (mut chosen, mut changed) = (Vec::new(), Vec::new());
        for &of in envs {
            let (law, costs) = (&mut self.laws[of], &rolled.costs[of * copies..][..copies]);
            // The first of equals, which goes furthest.
            let best = (0..copies).fold(0, |best, k| if costs[k] < costs[best] { k } else { best });
            let [least, most, factor] = DAMPING;
            law.damping = if best + 1 == copies { law.damping * factor } else { law.damping / factor }.clamp(least, most);
            let env = of * copies + best;
            let plan = &mut self.ahead.plans[of * size..][..size];
            plan.chunks_exact_mut(width).zip(&rolled.actions).for_each(|(plan, all)| plan.copy_from_slice(&all[env * width..][..width]));
            changed.extend_from_slice(plan);
            chosen.push(env);
        }
        let of = |all: &[Vec<f64>], width: usize| -> Vec<f64> {
            chosen.iter().flat_map(|env| all.iter().flat_map(move |now| &now[env * width..][..width])).copied().collect()
        };
        let (states, torques) = (of(&rolled.states, d), of(&rolled.torques, joints));
        let steps = linearise(&mut self.ahead.episodes, (present, envs), (&states, &torques, &changed), self.config.steps)?;
        let every = self.ahead.episodes.task.frames() as usize;
        let rows = states.chunks_exact((self.config.steps * every + 1) * d).zip(changed.chunks_exact(size));
        for ((env, steps), (states, plan)) in envs.iter().zip(&steps).zip(rows) {
            let law = &mut self.laws[*env];
            law.states = states.chunks_exact(d).step_by(every).map(<[f64]>::to_vec).collect();
            law.gains = gains(steps, plan, self.config.effort, law.damping);
        }
        Ok(())
    }
}

/// The way back over a plan: changes and gains of its actions.
fn gains(steps: &[Step], plan: &[f64], effort: f64, damping: f64) -> Vec<(DVector<f64>, DMatrix<f64>)> {
    let Some(first) = steps.first() else { return Vec::new() };
    let (size, width) = (first.by_state.ncols(), first.by_action.ncols());
    let (mut slope, mut curve) = (DVector::zeros(size), DMatrix::zeros(size, size));
    let mut all = Vec::with_capacity(steps.len());
    for (step, plan) in steps.iter().zip(plan.chunks_exact(width)).rev() {
        let Step { by_state: a, by_action: b, residuals, residuals_by } = step;
        // What the step leads to costs.
        slope += residuals_by.tr_mul(residuals);
        curve += residuals_by.tr_mul(residuals_by);
        let (at, vb) = (DVector::from_column_slice(plan), &curve * b);
        let by_action = b.tr_mul(&slope) + &at * effort;
        let by_state = a.tr_mul(&slope);
        let both = DMatrix::identity(width, width) * effort + b.tr_mul(&vb);
        let (mut damped, mut mixed) = (&both + b.tr_mul(b) * damping, vb.tr_mul(a) + b.tr_mul(a) * damping);
        let mut pulled = by_action.clone();
        for k in (0..width).filter(|k| at[*k].abs() >= 1.0 && at[*k] * by_action[*k] < 0.0) {
            damped.row_mut(k).fill(0.0);
            damped.column_mut(k).fill(0.0);
            damped[(k, k)] = 1.0;
            mixed.row_mut(k).fill(0.0);
            pulled[k] = 0.0;
        }
        let Some(factor) = damped.cholesky() else { return Vec::new() };
        let (change, gain) = (-factor.solve(&pulled), -factor.solve(&mixed));
        let mixed = vb.tr_mul(a);
        slope = by_state + gain.tr_mul(&(&both * &change + &by_action)) + mixed.tr_mul(&change);
        curve = a.tr_mul(&(&curve * a)) + gain.tr_mul(&(&both * &gain)) + gain.tr_mul(&mixed) + mixed.tr_mul(&gain);
        curve = (&curve + curve.transpose()) * 0.5;
        all.push((change, gain));
    }
    all.reverse();
    all
}

impl Planner for Ilqr {
    fn act(&mut self, present: &Episodes) -> Result<Vec<f64>, StepError> {
        self.laws.resize_with(present.len(), Law::default);
        let begun = self.ahead.begin(present)?;
        begun.iter().for_each(|env| self.laws[*env] = Law { damping: 1.0, ..Law::default() });
        let [usual, first] = self.config.rounds;
        let mut rounds = vec![usual; present.len()];
        begun.iter().for_each(|env| rounds[*env] = first);
        for round in 0..rounds.iter().copied().max().unwrap_or(0) {
            let envs: Vec<usize> = (0..rounds.len()).filter(|env| round < rounds[*env]).collect();
            self.round(present, &envs)?;
        }
        for law in &mut self.laws {
            if !law.gains.is_empty() {
                law.states.remove(0);
                law.gains.remove(0);
            }
        }
        self.ahead.take(present)
    }
}
