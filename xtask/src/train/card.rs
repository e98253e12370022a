//! What a run is, and what its model folder says of it.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use nerd_model::base::Base;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::normalizer::Normalizer;
use nerd_model::transformer::{Architecture, Storage, TransformerConfig, Weights};
use nerd_train::learner::{LearnerConfig, LearnerState};
use nerd_train::trainer::TrainerConfig;
use serde::{Deserialize, Serialize};

use super::TrainArgs;
use super::variant::Variant;
use crate::provenance::Provenance;

/// What decides a run's bytes; kept in its checkpoints, so that no run is continued as another one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    pub robot: String,
    pub truth: String,
    pub base: Base,
    #[serde(default, skip_serializing_if = "Variant::usual")]
    pub variant: Variant,
    pub network: TransformerConfig,
    pub learner: LearnerConfig,
    pub trainer: TrainerConfig,
    pub torque_scale: f64,
    pub hold: usize,
    pub resets: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policies: Option<String>,
    pub data_sha256: String,
    pub transitions: usize,
    /// Transitions recorded during the run.
    #[serde(default)]
    pub fresh: usize,
    /// What the weights it started from had been through.
    pub from: Option<String>,
}

/// The state to go on from, if the folder holds one of this very run.
pub fn resume(out: &Path, network: &TransformerConfig, run: &str) -> Result<Option<LearnerState>> {
    let path = out.join("last.safetensors");
    if !path.exists() {
        return Ok(None);
    }
    let (state, found) = nerd_train::checkpoint::load(&path, network)?;
    if found != run {
        bail!(
            "{}: belongs to a run with other settings; use another --out, or the settings in {}",
            path.display(),
            out.join("run.json").display()
        );
    }
    Ok(Some(state))
}

/// What `config.json` will hold.
pub fn model_config(run: &Run, provenance: &HashMap<String, String>) -> ModelConfig {
    let form = run.variant.form(run.base);
    ModelConfig {
        robot: run.robot.clone(),
        truth: run.truth.clone(),
        base: form.base,
        view: form.view,
        network: run.network,
        data_sha256: run.data_sha256.clone(),
        transitions: run.transitions + run.fresh,
        updates: run.trainer.updates,
        batch: run.learner.batch,
        provenance: provenance.clone(),
    }
}

/// What a model has been through, in one line.
pub fn history(config: &ModelConfig) -> String {
    let row = |k: &str| config.provenance.get(k).map_or("?", String::as_str);
    let run = format!(
        "{} of a run of {} updates of {} windows on {} transitions",
        row("weights"),
        config.updates,
        config.batch,
        config.transitions
    );
    let run = format!("{run} (`{}`, {} minutes on {}, commit {})", row("command"), row("minutes"), row("machine"), row("commit"));
    config.provenance.get("started from").map_or(run.clone(), |before| format!("{run}, which started from {before}"))
}

/// One line a validation: which updates took how long where. A run that is killed has those up to its best weights.
pub fn log_time(out: &Path, first: u64, last: u64, seconds: f64) -> Result<()> {
    use std::io::Write;
    let line = serde_json::json!({ "first": first, "last": last, "seconds": seconds, "machine": Provenance::machine() });
    let mut file = std::fs::OpenOptions::new().create(true).append(true).open(out.join("sessions.jsonl"))?;
    Ok(writeln!(file, "{line}")?)
}

/// Writes the model folder with a card made of what the run recorded.
pub fn export(
    folder: &Path,
    out: &Path,
    run: &Run,
    normalizer: Normalizer,
    weights: Weights,
    chosen: String,
    args: &TrainArgs,
) -> Result<()> {
    let sessions = std::fs::read_to_string(out.join("sessions.jsonl")).context("sessions.jsonl, the times of the run")?;
    let sessions: Vec<serde_json::Value> = sessions.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
    let seconds: f64 = sessions.iter().filter_map(|s| s["seconds"].as_f64()).sum();
    let machine = sessions.last().map_or_else(String::new, |s| s["machine"].as_str().unwrap_or_default().to_string());
    let stamp = Provenance::now(args.seed);
    let minutes = format!("{:.1}", seconds / 60.0);
    let rows = [
        ("commit", stamp.commit.clone()),
        ("command", stamp.command.clone()),
        ("seed", args.seed.to_string()),
        ("machine", machine),
        ("minutes", minutes),
        ("date", stamp.date.clone()),
        ("weights", chosen),
        ("optimizer", format!("{:?}", run.learner.optimizer)),
        ("schedule", format!("{:?}", run.trainer.schedule)),
        ("torque_scale", format!("U({}, 1)", run.torque_scale)),
    ];
    let rows: Vec<_> = rows.into_iter().chain(run.from.clone().map(|from| ("started from", from))).collect();
    let provenance = rows.iter().map(|(k, v)| (k.to_string(), v.clone())).collect();
    let config = model_config(run, &provenance);
    let mut card = format!(
        "# {} of `{}`\n\n{} ({} parameters, E {}, {} layers, window {}) that learned {} of `{}`.\n\
         {} updates of {} windows on {} random transitions (SHA-256{} `{}`).\n\n| | |\n|---|---|\n",
        run.variant.name(),
        run.robot,
        if run.network.architecture == Architecture::Transformer { "A causal Transformer" } else { "A network" },
        run.network.parameters(),
        run.network.embedding,
        run.network.layers,
        run.network.history,
        if run.base.flies() { "what contact adds to one frame of flight" } else { "one frame" },
        run.truth,
        run.trainer.updates,
        run.learner.batch,
        run.transitions + run.fresh,
        if run.fresh > 0 { format!(" of the first {}", run.transitions) } else { String::new() },
        run.data_sha256,
    );
    rows.iter().for_each(|(k, v)| card.push_str(&format!("| {k} | {v} |\n")));
    card.push_str("\nIts errors in rollouts stand in `results/`. Written by `cargo xtask train`.\n");
    // What is added to flight bears ten bits (a pendulum on ground 1: 0.0074 rad either way); a whole frame does not (0.013
    // becomes 0.017).
    let storage = if run.base.flies() { Storage::F16 } else { Storage::F32 };
    Ok(Model { config, normalizer, weights }.save(folder, &card, storage)?)
}
