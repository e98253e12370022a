//! Games of policies in the truth at other numbers of substeps.

use std::path::Path;

use nerd_sim::prelude::*;
use nerd_tasks::{Episodes, named};
use serde::{Deserialize, Serialize};

use super::{at, taken};
use crate::error::Result;
use crate::experiments::games::{Reward, finished};
use crate::report::Table;
use nerd_train::ppo::{Game, folder};
use nerd_train::shipped::from_root;

/// Half, once and twice the truth's substeps.
const TIMES: [f64; 3] = [0.5, 1.0, 2.0];

/// One policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Played {
    /// Task.
    pub task: String,
    /// Folder of the policy.
    pub policy: String,
    /// What it was trained in.
    pub trained_in: String,
    /// Games at each number of substeps.
    pub games: usize,
    /// Substeps of the truth.
    pub substeps: usize,
    /// At half, once and twice as many.
    pub rewards: [Reward; 3],
    /// What half and twice as many change, pair by pair: the mean and its standard error.
    pub changes: [(f64, f64); 2],
}

/// Plays a policy.
///
/// # Errors
/// If it cannot be read, or the truth cannot step.
pub(super) fn measure(path: &Path, n: usize, seed: u64) -> Result<Played> {
    let (config, policy) = folder::load(path)?;
    let task = named(&config.task)?;
    let system = System::named(task.robot())?;
    let scene = system.scene(task.scene())?;
    let play = |times: f64| -> Result<Vec<Game>> {
        let solver = at(&system, times);
        let title = format!("{}, {} substeps", from_root(path), taken(&system, &scene, &solver));
        let simulation = Simulation::new(Batch::new(&system, &scene, n), Articulated::new(solver));
        finished(&title, Episodes::new(named(&config.task)?, simulation, seed), &policy)
    };
    let [half, own, twice] = [play(TIMES[0])?, play(TIMES[1])?, play(TIMES[2])?];
    Ok(Played {
        policy: from_root(path),
        trained_in: config.solver.clone(),
        games: n,
        substeps: taken(&system, &scene, &at(&system, 1.0)),
        changes: [change(&own, &half), change(&own, &twice)],
        rewards: [&half, &own, &twice].map(|games| Reward::of(games)),
        task: config.task.clone(),
    })
}

/// Mean of the second's rewards less the first's, of games that began alike, and its standard error.
fn change(own: &[Game], other: &[Game]) -> (f64, f64) {
    let apart: Vec<f64> = own.iter().zip(other).map(|(a, b)| b.reward - a.reward).collect();
    let n = apart.len() as f64;
    let mean = apart.iter().sum::<f64>() / n;
    let square = apart.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
    (mean, (square / (n - 1.0).max(1.0) / n).sqrt())
}

/// Tasks, means over their policies.
pub(super) fn table(rows: &[Played]) -> Table {
    let lines = nerd_tasks::names().into_iter().filter_map(|task| {
        let rows: Vec<&Played> = rows.iter().filter(|r| r.task == task).collect();
        let first = rows.first()?;
        let count = rows.len() as f64;
        let reward = |k: usize| rows.iter().map(|r| r.rewards[k].mean).sum::<f64>() / count;
        let percent = |x: f64| 100.0 * x / reward(1).abs();
        let change = |k: usize| {
            let mean = rows.iter().map(|r| r.changes[k].0).sum::<f64>() / count;
            let error = rows.iter().map(|r| r.changes[k].1.powi(2)).sum::<f64>().sqrt() / count;
            format!("{:+.2} ± {:.2}", percent(mean), percent(error))
        };
        let own = |r: &Played| 100.0 * r.changes[1].0 / r.rewards[1].mean.abs();
        let most = rows.iter().max_by(|a, b| own(a).abs().total_cmp(&own(b).abs()))?;
        let name = most.policy.rsplit('/').next().unwrap_or_default();
        let error = 100.0 * most.changes[1].1 / most.rewards[1].mean.abs();
        Some(vec![
            task.to_string(),
            format!("{} x {}", rows.len(), first.games),
            first.substeps.to_string(),
            format!("{:.1} / {:.1} / {:.1}", reward(0), reward(1), reward(2)),
            change(0),
            change(1),
            format!("{:+.2} ± {error:.2}, {name}", own(most)),
        ])
    });
    let header = [
        "task",
        "policies x games",
        "substeps",
        "reward at half of them / the truth's / twice",
        "change at half (%)",
        "at twice (%)",
        "largest of a policy at twice (%)",
    ];
    Table::new("rewards", &header).with(lines).noted(
        "Mean reward of a game under mean actions, over policies. ±: standard error of the difference between games that begin alike.",
    )
}
