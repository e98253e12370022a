//! Whole episodes under a policy's mean actions.

use nerd_tasks::plan::Planner;

use super::*;

/// One game.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Game {
    /// Sum of rewards.
    pub reward: f64,
    /// Steps.
    pub length: f64,
    /// Mean of [`nerd_tasks::Task::miss`] over its last half, if its task speaks of success: it has succeeded where that is 1 at most.
    pub miss: Option<f64>,
    /// Whether it went on to its end, and its miss was 1 at most throughout its last quarter.
    pub stayed: bool,
}

/// The first episode of every environment, which should have just begun, under the policy's mean actions. `progress` receives after each step how many have ended.
pub fn play(policy: &Policy, episodes: &mut Episodes, progress: &mut dyn FnMut(usize)) -> Result<Vec<Game>, StepError> {
    let actor = Actor::new(policy.clone());
    played(policy.shape.stack, &mut |_, seen| Ok(actor.mean(seen)), episodes, progress)
}

/// The same under actions that a planner finds.
pub fn plan(planner: &mut dyn Planner, episodes: &mut Episodes, progress: &mut dyn FnMut(usize)) -> Result<Vec<Game>, StepError> {
    played(1, &mut |episodes, _| planner.act(episodes), episodes, progress)
}

/// Actions by the episodes, and so many of their observations.
type Act<'a> = &'a mut dyn FnMut(&Episodes, &[f64]) -> Result<Vec<f64>, StepError>;

fn played(stack: usize, act: Act, episodes: &mut Episodes, progress: &mut dyn FnMut(usize)) -> Result<Vec<Game>, StepError> {
    let (mut running, length) = (Running::new(episodes, stack), episodes.task.episode_length() as usize);
    let (mut games, mut reached) = (vec![None; episodes.len()], Vec::new());
    let mut misses = vec![Vec::new(); games.len()];
    while games.iter().any(Option::is_none) {
        let actions = act(episodes, &running.stack.rows)?;
        let (result, ended) = running.step(episodes, &actions, &mut reached)?;
        misses.iter_mut().zip(result.misses).for_each(|(all, miss)| all.push(miss));
        for Ended { env, total: reward, length: steps, .. } in ended {
            let misses = std::mem::take(&mut misses[env]);
            let (miss, stayed) = (last_half(&misses), stayed(&misses, length));
            games[env].get_or_insert(Game { reward, length: steps, miss, stayed });
        }
        progress(games.iter().flatten().count());
    }
    Ok(games.into_iter().flatten().collect())
}

/// Whether every miss of the last quarter of an episode of so many steps is 1 at most; not in one that ended before.
fn stayed(misses: &[Option<f64>], length: usize) -> bool {
    misses.len() >= length && misses[length - length / 4..].iter().all(|miss| miss.is_some_and(|miss| miss <= 1.0))
}

/// Mean miss over the last half of an episode; infinite of one that was broken off.
fn last_half(misses: &[Option<f64>]) -> Option<f64> {
    let last = &misses[misses.len() / 2..];
    let sum: f64 = last.iter().map(|miss| miss.unwrap_or(f64::INFINITY)).sum();
    misses.iter().any(Option::is_some).then_some(sum / last.len() as f64)
}
