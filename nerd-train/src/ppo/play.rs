//! Whole episodes under a policy's mean actions.

use nerd_sim::solver::StepError;

use super::environments::Environments;
use super::policy::Policy;
use super::rollout::Running;

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
        let mean = policy.answer(&running.stack.rows).mean;
        let actions: Vec<f64> = mean.into_iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect();
        for (env, reward, length) in running.step(environments, &actions, &mut reached)?.ended {
            games[env].get_or_insert(Game { reward, length });
        }
        progress(games.iter().flatten().count());
    }
    Ok(games.into_iter().flatten().collect())
}
