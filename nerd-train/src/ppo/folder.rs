//! A policy is a folder: `config.json`, `policy.safetensors` and a card, `README.md`.
//!
//! Weights are named `layerK.weight` `[in, out]` and `layerK.bias`; the last layer's outputs are mean action, value and, unless it is a
//! parameter (`log_std`), the logarithm of the spread. `observation.mean` and `observation.variance` normalise inputs, `return.mean` and
//! `return.variance` the value.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use nerd_tasks::Task;
use serde::{Deserialize, Serialize};

use super::config::PpoConfig;
use super::normalizer::RunningMoments;
use super::policy::{Policy, Shape};
use super::tensors::{Reader, Writer};
use crate::checkpoint::CheckpointError;

/// What was learned, where, how; `config.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyConfig {
    /// Task.
    pub task: String,
    /// What the policy was trained in.
    pub solver: String,
    /// Shape of the network.
    pub shape: Shape,
    /// How it was trained.
    pub ppo: PpoConfig,
    /// Iterations done.
    pub iterations: u64,
    /// Mean return of its own noisy episodes.
    pub reward: Option<f64>,
    /// Commit, command, seed, machine, minutes.
    #[serde(default)]
    pub provenance: BTreeMap<String, String>,
}

/// Writes the folder, each file whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub fn save(folder: &Path, config: &PolicyConfig, policy: &Policy, card: &str) -> Result<(), CheckpointError> {
    let (mut file, mut rest) = (Writer::default(), policy.flat.as_slice());
    for tensor in policy.shape.program().tensors {
        let (entries, behind) = rest.split_at(tensor.len());
        rest = behind;
        file.f32(&tensor.name, &tensor.shape, entries);
    }
    for (name, moments) in [("observation", &policy.seen), ("return", &policy.returns)] {
        file.f64(format!("{name}.mean"), moments.mean.iter().copied());
        file.f64(format!("{name}.variance"), moments.variance.iter().copied());
        file.f64(format!("{name}.count"), [moments.count]);
    }
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        nerd_sim::files::write(&path, text.as_bytes()).map_err(|source| CheckpointError::Io { path, source })
    };
    let path = folder.join("config.json");
    let json = serde_json::to_string_pretty(config).map_err(|e| CheckpointError::Format { path, reason: e.to_string() })?;
    write("README.md", card.into())?;
    file.save(&folder.join("policy.safetensors"), HashMap::from([("task".into(), config.task.clone())]))?;
    // Last: a folder that has it is whole.
    write("config.json", json + "\n")
}

/// Reads the folder of a policy of a built-in task.
///
/// # Errors
/// If a file is absent or not what it should be.
pub fn load(folder: &Path) -> Result<(PolicyConfig, Policy), CheckpointError> {
    read(folder, |config| check(config, &*nerd_tasks::named(&config.task).map_err(|e| e.to_string())?))
}

/// Reads the folder of a policy of this task, built-in or not.
///
/// # Errors
/// If a file is absent or not what it should be, or the policy is of another task.
pub fn load_for(folder: &Path, task: &dyn Task) -> Result<(PolicyConfig, Policy), CheckpointError> {
    read(folder, |config| match config.task == task.name() {
        true => check(config, task),
        false => Err(format!("a policy of task `{}`, not of `{}`", config.task, task.name())),
    })
}

fn read(folder: &Path, check: impl Fn(&PolicyConfig) -> Result<(), String>) -> Result<(PolicyConfig, Policy), CheckpointError> {
    let path = folder.join("config.json");
    let text = std::fs::read_to_string(&path).map_err(|source| CheckpointError::Io { path: path.clone(), source })?;
    let wrong = |reason: String| CheckpointError::Format { path: path.clone(), reason };
    let config: PolicyConfig = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    check(&config).map_err(wrong)?;
    let path = folder.join("policy.safetensors");
    let bytes = std::fs::read(&path).map_err(|source| CheckpointError::Io { path: path.clone(), source })?;
    let file = Reader::new(&path, &bytes)?;
    let (shape, mut flat) = (config.shape.clone(), Vec::new());
    for tensor in shape.program().tensors {
        flat.extend(file.f32(&tensor.name, Some(tensor.len()))?);
    }
    let moments = |name: &str, columns: usize| {
        let column = |what: &str, n: usize| file.f64(&format!("{name}.{what}"), Some(n));
        Ok(RunningMoments { mean: column("mean", columns)?, variance: column("variance", columns)?, count: column("count", 1)?[0] })
    };
    let seen = moments("observation", shape.inputs())?;
    let returns = moments("return", 1)?;
    let of = |m: &RunningMoments| {
        m.mean.iter().all(|x| x.is_finite()) && m.variance.iter().chain([&m.count]).all(|x| x.is_finite() && *x >= 0.0)
    };
    if !flat.iter().all(|w| w.is_finite()) || !of(&seen) || !of(&returns) {
        return Err(file.wrong("a weight or a moment is no finite number, or a variance is below 0"));
    }
    Ok((config, Policy { shape, flat, seen, returns }))
}

/// Says what of a policy does not fit its task.
fn check(config: &PolicyConfig, task: &dyn Task) -> Result<(), String> {
    let Shape { observation, action, .. } = config.shape;
    config.shape.check().map_err(|e| format!("shape: {e}"))?;
    config.ppo.check().map_err(|e| e.to_string())?;
    let wanted = (task.observation_dim(), task.action_dim());
    if (observation, action) != wanted {
        return Err(format!("maps {observation} to {action} numbers; task `{}` needs {} to {}", config.task, wanted.0, wanted.1));
    }
    Ok(())
}
