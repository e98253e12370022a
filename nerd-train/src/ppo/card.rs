//! The card of a policy.

use std::path::Path;

use super::curve;
use super::folder::{PolicyConfig, save};
use super::trainer::Trainer;
use crate::error::Result;
use crate::records::{Session, rows};

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
    curve::write(out, &out.join("policy"))
}
