//! What planners share: copies of the environments that are planned for, in a solver that looks ahead.

use nerd_sim::solver::StepError;

use crate::Episodes;

/// Reward of a step after an episode has ended by its state: below that of any other.
const ENDED: f64 = -100.0;

/// The copies, and the plan of each environment.
pub(super) struct Ahead {
    /// Environment e is looked ahead of in those from `e copies` on.
    pub episodes: Episodes,
    pub copies: usize,
    /// Steps of a plan.
    pub steps: usize,
    /// `[env][step][action]`.
    pub plans: Vec<f64>,
    /// What the solver that looks ahead would remember had it made the frames so far, and how many these are, by environment.
    pasts: Vec<(u64, Vec<f64>)>,
}

impl Ahead {
    pub fn new(mut episodes: Episodes, copies: usize, steps: usize) -> Self {
        episodes.copies = true;
        Self { episodes, copies, steps, plans: Vec::new(), pasts: Vec::new() }
    }

    /// Numbers in a plan.
    pub fn size(&self) -> usize {
        self.steps * self.episodes.task.action_dim()
    }

    /// Takes environments to plan for: a plan of zeros is begun for every episode that has just begun, and for what was not followed. Those.
    pub fn begin(&mut self, present: &Episodes) -> Result<Vec<usize>, StepError> {
        let (mine, theirs) = (&self.episodes, present);
        let same = mine.task.name() == theirs.task.name() && mine.task.robot() == theirs.task.robot();
        if !same || mine.len() != self.copies * theirs.len() {
            return Err(StepError::Solver(format!(
                "a planner with {} environments of `{}` in which it looks ahead, {} for each, was given {} of `{}`",
                mine.len(),
                mine.task.name(),
                self.copies,
                theirs.len(),
                theirs.task.name()
            )));
        }
        let size = self.size();
        self.plans.resize(present.len() * size, 0.0);
        self.pasts.resize(present.len(), (0, Vec::new()));
        let mut begun = Vec::new();
        for (env, (frame, memory)) in self.pasts.iter_mut().enumerate() {
            let now = present.simulation.batch.frames[env];
            if now == 0 || now != *frame {
                memory.clear();
                self.plans[env * size..][..size].fill(0.0);
                begun.push(env);
            }
        }
        Ok(begun)
    }

    /// Puts every copy where its environment is, with what would be remembered there.
    pub fn place(&mut self, present: &Episodes) -> Result<(), StepError> {
        for (env, (_, memory)) in self.pasts.iter().enumerate() {
            let first = env * self.copies;
            self.episodes.place(first, present, env);
            self.episodes.simulation.solver.recall(first, memory)?;
            (1..self.copies).try_for_each(|k| self.episodes.fork(first, first + k))?;
        }
        Ok(())
    }

    /// Looks ahead from where the copies are, under actions `[step][copy][action]`: the sum of rewards of each copy.
    pub fn rewards(&mut self, actions: &[f64]) -> Result<Vec<f64>, StepError> {
        let n = self.episodes.len();
        let (mut totals, mut ended, mut over) = (vec![0.0; n], vec![false; n], vec![false; n]);
        for actions in actions.chunks_exact(n * self.episodes.task.action_dim()) {
            let result = self.episodes.step(actions)?;
            for env in 0..n {
                // Out of time: what comes is no part of the episode.
                if !over[env] {
                    ended[env] |= result.terminated[env];
                    totals[env] += if ended[env] { ENDED } else { result.rewards[env] };
                    over[env] = !ended[env] && result.truncated[env];
                }
            }
        }
        Ok(totals)
    }

    /// The first actions of all plans, which go on by a step. A solver with memory makes the step, to remember it.
    pub fn take(&mut self, present: &Episodes) -> Result<Vec<f64>, StepError> {
        let (width, size) = (self.episodes.task.action_dim(), self.size());
        let mut actions = Vec::with_capacity(present.len() * width);
        for plan in self.plans.chunks_exact_mut(size) {
            actions.extend_from_slice(&plan[..width]);
            plan.copy_within(width.., 0);
            plan[size - width..].fill(0.0);
        }
        let remembers = !self.episodes.simulation.solver.remembered(0)?.is_empty();
        if remembers {
            self.place(present)?;
            let actions: Vec<f64> = actions.chunks_exact(width).flat_map(|action| action.repeat(self.copies)).collect();
            self.episodes.step(&actions)?;
        }
        for (env, past) in self.pasts.iter_mut().enumerate() {
            past.0 = present.simulation.batch.frames[env] + self.episodes.task.frames();
            if remembers {
                past.1 = self.episodes.simulation.solver.remembered(env * self.copies)?;
            }
        }
        Ok(actions)
    }
}
