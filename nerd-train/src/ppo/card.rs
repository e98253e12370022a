//! The card of a policy.

use std::collections::BTreeMap;
use std::path::Path;

use super::curve;
use super::folder::{PolicyConfig, save};
use super::trainer::Trainer;
use crate::error::Result;
use crate::provenance::Provenance;
use crate::records::Session;

/// Writes `<out>/policy`.
pub fn export(out: &Path, task: &str, (solver, identity): (&str, &str), trainer: &Trainer) -> Result<()> {
    let sessions = Session::all(out)?;
    let (minutes, machine) = Session::sum(&sessions);
    let stamp = Provenance::now(trainer.seed);
    let rows = [
        ("commit", stamp.commit),
        ("command", stamp.command),
        ("seed", stamp.seed.to_string()),
        ("machine", machine),
        ("spent", sessions.last().map(|s| s.spent.clone()).unwrap_or_default()),
        ("minutes", minutes),
        ("learned in", identity.to_string()),
        ("date", stamp.date),
    ];
    let (policy, reward) = trainer.best();
    let config = PolicyConfig {
        task: task.into(),
        solver: solver.into(),
        shape: policy.shape.clone(),
        ppo: trainer.config.clone(),
        iterations: trainer.state.iteration,
        reward,
        provenance: rows.iter().map(|(k, v)| (k.to_string(), v.clone())).collect::<BTreeMap<_, _>>(),
    };
    let mut card = format!(
        "# A policy of `{task}`\n\nTrained by PPO in `{solver}`: {} iterations of {} environments x {} steps. Network {:?} {:?}, {} \
         parameters; the best of the run by mean training reward{}.\n\n| | |\n|---|---|\n",
        trainer.state.iteration,
        trainer.config.environments,
        trainer.config.horizon,
        policy.shape.widths(),
        policy.shape.activation,
        policy.flat.len(),
        reward.map_or_else(String::new, |r| format!(", {r:.1}")),
    );
    rows.iter().for_each(|(k, v)| card.push_str(&format!("| {k} | {v} |\n")));
    card.push_str(
        "\n`cargo xtask policy evaluate` plays it in the truth and in the learned simulator. Written by `cargo xtask policy train`.\n",
    );
    save(&out.join("policy"), &config, policy, &card)?;
    curve::write(out, &out.join("policy"))
}
