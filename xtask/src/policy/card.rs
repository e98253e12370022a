//! What a policy's folder says of it.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use nerd_tasks::Episodes;
use nerd_train::ppo::Trainer;
use nerd_train::ppo::folder::{PolicyConfig, save};

use crate::provenance::Provenance;

/// One line a session: which iterations took how long where, and on what.
pub fn log_time(out: &Path, first: u64, last: u64, seconds: f64, spent: &str) -> Result<()> {
    use std::io::Write;
    let line = serde_json::json!({ "first": first, "last": last, "seconds": seconds, "machine": Provenance::machine(), "spent": spent });
    let path = out.join("sessions.jsonl");
    let file = std::fs::OpenOptions::new().create(true).append(true).open(&path);
    let mut file = file.with_context(|| format!("cannot write {}", path.display()))?;
    Ok(writeln!(file, "{line}")?)
}

/// Writes `<out>/policy`.
pub fn export(out: &Path, task: &str, solver: &str, trainer: &Trainer<Episodes>) -> Result<()> {
    let text = std::fs::read_to_string(out.join("sessions.jsonl")).context("the run's sessions.jsonl cannot be read")?;
    let sessions = text.lines().map(serde_json::from_str).collect::<Result<Vec<serde_json::Value>, _>>()?;
    let seconds: f64 = sessions.iter().filter_map(|s| s["seconds"].as_f64()).sum();
    let machine = sessions.last().and_then(|s| s["machine"].as_str()).unwrap_or_default().to_string();
    let stamp = Provenance::now(trainer.seed);
    let rows = [
        ("commit", stamp.commit),
        ("command", stamp.command),
        ("seed", stamp.seed.to_string()),
        ("machine", machine),
        ("spent", sessions.last().and_then(|s| s["spent"].as_str()).unwrap_or_default().to_string()),
        ("minutes", format!("{:.1}", seconds / 60.0)),
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
        "# A policy of `{task}`\n\nLearned by PPO in `{solver}`: {} iterations of {} environments x {} steps. Network {:?} {:?}, {} \
         parameters; the best of the run by the mean reward of its own noisy episodes{}.\n\n| | |\n|---|---|\n",
        trainer.state.iteration,
        trainer.config.environments,
        trainer.config.horizon,
        policy.shape.network().sizes,
        policy.shape.activation,
        policy.flat.len(),
        reward.map_or_else(String::new, |r| format!(", {r:.1}")),
    );
    rows.iter().for_each(|(k, v)| card.push_str(&format!("| {k} | {v} |\n")));
    card.push_str("\nWhat it earns in the truth and in the learned simulator: `cargo xtask policy evaluate`. Written by `cargo xtask policy train`.\n");
    save(&out.join("policy"), &config, policy, &card)?;
    super::curve::write(out, &out.join("policy"))
}
