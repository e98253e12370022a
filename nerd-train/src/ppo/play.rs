//! Whole episodes under a policy's mean actions.

use super::*;

/// One game.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Game {
    /// Sum of rewards.
    pub reward: f64,
    /// Steps.
    pub length: f64,
    /// Mean of [`nerd_tasks::Task::miss`] over its last half, if its task speaks of success: it has succeeded where that is 1 at most.
    pub miss: Option<f64>,
    /// Sums of [`nerd_tasks::Task::terms`].
    pub terms: Vec<f64>,
}

/// The first episode of every environment, which should have just begun, under the policy's mean actions. `progress` receives after each step how many have ended.
pub fn play(policy: &Policy, episodes: &mut Episodes, progress: &mut dyn FnMut(usize)) -> Result<Vec<Game>, StepError> {
    let (actor, mut running) = (Actor::new(policy.clone()), Running::new(episodes, policy.shape.stack));
    let (mut games, mut reached) = (vec![None; episodes.len()], Vec::new());
    let (mut misses, width) = (vec![Vec::new(); games.len()], episodes.task.terms().len());
    let mut terms = vec![vec![0.0; width]; games.len()];
    while games.iter().any(Option::is_none) {
        let actions = actor.mean(&running.stack.rows);
        let (result, ended) = running.step(episodes, &actions, &mut reached)?;
        misses.iter_mut().zip(result.misses).for_each(|(all, miss)| all.push(miss));
        let all = terms.iter_mut().zip(result.terms.chunks_exact(width.max(1)));
        all.for_each(|(sums, terms)| sums.iter_mut().zip(terms).for_each(|(sum, x)| *sum += x));
        for Ended { env, total: reward, length, .. } in ended {
            let (misses, terms) = (std::mem::take(&mut misses[env]), std::mem::replace(&mut terms[env], vec![0.0; width]));
            games[env].get_or_insert(Game { reward, length, miss: last_half(&misses), terms });
        }
        progress(games.iter().flatten().count());
    }
    Ok(games.into_iter().flatten().collect())
}

/// Mean miss over the last half of an episode; infinite of one that was broken off.
fn last_half(misses: &[Option<f64>]) -> Option<f64> {
    let last = &misses[misses.len() / 2..];
    let sum: f64 = last.iter().map(|miss| miss.unwrap_or(f64::INFINITY)).sum();
    misses.iter().any(Option::is_some).then_some(sum / last.len() as f64)
}
