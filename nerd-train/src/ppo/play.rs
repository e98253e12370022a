//! Whole episodes under a policy's mean actions.

use nerd_sim::solver::StepError;
use nerd_tasks::Episodes;

use super::environments::Environments;
use super::policy::Policy;
use super::rollout::Running;
use crate::progress::bar;
use crate::report::replay::Replay;

/// One game.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Game {
    /// Sum of rewards.
    pub reward: f64,
    /// Steps.
    pub length: f64,
}

/// The first episode of every environment, which should have just begun. `progress` is told after each step how many have ended.
///
/// # Errors
/// If the solver cannot step.
pub fn play(policy: &Policy, environments: &mut impl Environments, progress: &mut dyn FnMut(usize)) -> Result<Vec<Game>, StepError> {
    let mut running = Running::new(environments, policy.shape.stack);
    let (mut games, mut reached) = (vec![None; environments.count()], Vec::new());
    while games.iter().any(Option::is_none) {
        for (env, reward, length) in running.step(environments, &actions(policy, &running), &mut reached)?.ended {
            games[env].get_or_insert(Game { reward, length });
        }
        progress(games.iter().flatten().count());
    }
    Ok(games.into_iter().flatten().collect())
}

/// The first episode of the first environment, which should have just begun, to be looked at: poses, goals and rewards so far by
/// step; and its whole reward.
///
/// # Errors
/// If the solver cannot step.
pub fn replay(policy: &Policy, episodes: &mut Episodes, title: &str) -> Result<(Replay, f64), StepError> {
    let bar = bar(title, episodes.task.episode_length());
    let dt = episodes.simulation.batch.system.frame_time * episodes.task.frames() as f64;
    let mut page = Replay::new(title, &episodes.simulation.batch, dt);
    page.begin(title);
    let (mut running, mut reached, mut total) = (Running::new(episodes, policy.shape.stack), Vec::new(), 0.0);
    loop {
        page.add(&episodes.simulation.batch);
        page.goals.push(episodes.view(0).goal.iter().map(|x| *x as f32).collect());
        page.rewards.push(total as f32);
        bar.set(page.frames() as u64);
        let stepped = running.step(episodes, &actions(policy, &running), &mut reached)?;
        total += stepped.result.rewards[0];
        if !stepped.ended.is_empty() {
            bar.finish();
            return Ok((page, total));
        }
    }
}

/// Mean actions at what is seen now.
fn actions(policy: &Policy, running: &Running) -> Vec<f64> {
    policy.answer(&running.stack.rows).mean.into_iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect()
}
