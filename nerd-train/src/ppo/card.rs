//! What a run makes of its best policy: its folder with a card and the learning curve.

use std::path::Path;

use super::folder::{PolicyConfig, save};
use super::{Iteration, Trainer};
use crate::error::{Error, Result};
use crate::records::{Session, rows};

/// Points that a shipped curve has, about.
const POINTS: usize = 100;

/// Writes `<out>/policy`.
pub fn export(out: &Path, task: &str, (solver, identity): (&str, &str), trainer: &Trainer) -> Result<()> {
    let spent = Session::all(out)?.last().map(|s| s.spent.clone()).unwrap_or_default();
    let (provenance, table) = rows(out, trainer.seed, vec![("spent", spent), ("learned in", identity.into())])?;
    let (policy, reward) = trainer.best();
    let (shape, ppo, iterations) = (policy.shape.clone(), trainer.config.clone(), trainer.state.iteration);
    let card = format!(
        "# A policy of `{task}`\n\nTrained by PPO in `{solver}`: {iterations} iterations of {} environments x {} steps. Network {:?} {:?}, {} \
         parameters; the best of the run by mean training reward{}.\n\n{table}\n\
         `cargo xtask policy evaluate` plays it in the truth and in the learned simulator. Written by `cargo xtask policy train`.\n",
        ppo.environments,
        ppo.horizon,
        shape.widths(),
        shape.activation,
        policy.flat.len(),
        reward.map_or_else(String::new, |r| format!(", {r:.1}")),
    );
    let config = PolicyConfig { task: task.into(), solver: solver.into(), shape, ppo, iterations, reward, provenance };
    save(&out.join("policy"), &config, policy, &card)?;
    curve(out, &out.join("policy"))
}

/// Writes `curve.csv` for a run's policy: steps, mean reward and mean length of episodes, thinned out.
fn curve(out: &Path, folder: &Path) -> Result<()> {
    let metrics = out.join("metrics.jsonl");
    let lines = std::fs::read_to_string(&metrics).map_err(Error::file(&metrics))?;
    let lines: Vec<Iteration> = lines.lines().map(serde_json::from_str).collect::<Result<_, _>>().map_err(Error::file(&metrics))?;
    let every = lines.len().div_ceil(POINTS).max(1);
    let mut text = String::from("steps,reward,length\n");
    for line in lines.iter().filter(|l| (l.step as usize).is_multiple_of(every)) {
        if let (Some(reward), Some(length)) = (line.reward, line.length) {
            text.push_str(&format!("{},{reward:.2},{length:.1}\n", line.frames));
        }
    }
    let path = folder.join("curve.csv");
    nerd_sim::files::write(&path, text.as_bytes()).map_err(Error::file(&path))
}
