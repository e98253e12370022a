//! Whole episodes under a policy's mean actions.

use super::*;

/// Result of one episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Game {
    /// Sum of rewards.
    pub reward: f64,
    /// Length of the episode (steps).
    pub length: f64,
    /// Mean of [`nerd_tasks::Task::error`] over the last half of the episode, if the task defines success. An error of
    /// at most 1 is a success.
    pub error: Option<f64>,
    /// Sum over the episode of each of [`nerd_tasks::Task::terms`].
    pub terms: Vec<f64>,
}

/// Plays the first episode of every environment under the policy's mean actions; episodes should have just begun. Calls
/// `progress` after each step with the number of ended episodes.
pub fn play(policy: &Policy, episodes: &mut Episodes, progress: &mut dyn FnMut(usize)) -> Result<Vec<Game>, StepError> {
    let actor = Actor::new(policy.clone());
    let mut running = Running::new(episodes, policy.shape.stack);
    let mut games = vec![None; episodes.len()];
    let mut reached = Vec::new();
    let mut errors = vec![Vec::new(); games.len()];
    let width = episodes.task.terms().len();
    let mut terms = vec![vec![0.0; width]; games.len()];
    while games.iter().any(Option::is_none) {
        let actions = actor.mean(&running.stack.rows);
        let (result, ended) = running.step(episodes, &actions, &mut reached)?;
        errors.iter_mut().zip(result.errors).for_each(|(all, error)| all.push(error));
        let all = terms.iter_mut().zip(result.terms.chunks_exact(width.max(1)));
        all.for_each(|(sums, terms)| add(sums, terms));
        for Ended { env, total: reward, length, .. } in ended {
            let errors = std::mem::take(&mut errors[env]);
            let terms = std::mem::replace(&mut terms[env], vec![0.0; width]);
            games[env].get_or_insert(Game { reward, length, error: last_half(&errors), terms });
        }
        progress(games.iter().flatten().count());
    }
    Ok(games.into_iter().flatten().collect())
}

/// Mean of [`nerd_tasks::Task::error`] over the last half of an episode; infinite if the solver failed in that half.
fn last_half(errors: &[Option<f64>]) -> Option<f64> {
    let last = &errors[errors.len() / 2..];
    let sum: f64 = last.iter().map(|error| error.unwrap_or(f64::INFINITY)).sum();
    errors.iter().any(Option::is_some).then_some(sum / last.len() as f64)
}
