//! Replays: web pages that show motion. [`episode`] shows an episode of a policy, in any task.

mod page;
mod solids;

pub use page::{Ground, Replay, Track, poses};
// Used by pages with several replays.
#[doc(hidden)]
pub use page::{SCRIPT, escape, fill, script};
pub use solids::Solid;

use crate::ppo::{Actor, Policy, Running};
use crate::prelude::*;

/// Plays an episode of the first environment, from its present state to its end. Returns the replay (poses, goals,
/// return so far) and the total reward. [`Replay::html`] makes the page.
pub fn episode(policy: &Policy, episodes: &mut Episodes, title: &str) -> Result<(Replay, f64), StepError> {
    let dt = episodes.simulation.batch.system.frame_time * episodes.task.frames() as f64;
    let mut page = Replay::new(title, &episodes.simulation.batch, dt);
    let total = record(&mut page, title, &Actor::new(policy.clone()), episodes, usize::MAX)?;
    Ok((page, total))
}

/// Adds an episode under mean actions, or its first `steps` steps, to a page; returns its total reward. Only the first
/// track of a page has goals and rewards.
pub fn record(
    page: &mut Replay,
    name: &str,
    actor: &Actor,
    episodes: &mut Episodes,
    steps: usize,
) -> Result<f64, StepError> {
    page.begin(name);
    let mut running = Running::new(episodes, actor.policy.shape.stack);
    let mut reached = Vec::new();
    let mut total = 0.0;
    for _ in 0..steps {
        page.add(&episodes.simulation.batch);
        if page.tracks.len() == 1 {
            let shown = if episodes.task.place() { episodes.view(0).goal } else { &[] };
            page.goals.push(shown.iter().map(|x| *x as f32).collect());
            page.rewards.push(total as f32);
        }
        let (result, ended) = running.step(episodes, &actor.mean(&running.stack.rows), &mut reached)?;
        total += result.rewards[0];
        if !ended.is_empty() {
            break;
        }
    }
    Ok(total)
}
