//! One episode of a policy, as a page to look at.

use nerd_sim::solver::StepError;
use nerd_tasks::Episodes;

use super::page::Replay;
use crate::ppo::{Actor, Policy, Running};
use crate::progress::bar;

/// The first episode of the first environment, which should have just begun, to be looked at: poses, goals and rewards so far by
/// step; and its whole reward. [`Replay::html`] is the page.
///
/// # Errors
/// If the solver cannot step.
pub fn episode(policy: &Policy, episodes: &mut Episodes, title: &str) -> Result<(Replay, f64), StepError> {
    let bar = bar(title, episodes.task.episode_length());
    let dt = episodes.simulation.batch.system.frame_time * episodes.task.frames() as f64;
    let mut page = Replay::new(title, &episodes.simulation.batch, dt);
    page.begin(title);
    let (mut running, mut reached, mut total) = (Running::new(episodes, policy.shape.stack), Vec::new(), 0.0);
    let actor = Actor::new(policy.clone());
    loop {
        page.add(&episodes.simulation.batch);
        page.goals.push(episodes.view(0).goal.iter().map(|x| *x as f32).collect());
        page.rewards.push(total as f32);
        bar.set(page.frames() as u64);
        let stepped = running.step(episodes, &actor.mean(&running.stack.rows), &mut reached)?;
        total += stepped.result.rewards[0];
        if !stepped.ended.is_empty() {
            bar.finish();
            return Ok((page, total));
        }
    }
}
