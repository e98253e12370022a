//! Whether the models that ship have earned their places ([`Verdict`]).

use nerd_model::transformer::Architecture;
use nerd_train::verdict::Verdict;

use super::Rows;
use crate::prelude::*;
use crate::report::{Artifact, Manifest};

/// A line for each model in a folder that no result, or one of its scenes, shows to be worth its network. Models of the reference simulator
/// are as the paper has them, and cables have no linear map: both are left out.
pub fn unworthy(manifest: &Manifest, results: &Path, models: &Path) -> Result<Vec<String>> {
    let measured = manifest.artefact.iter().filter_map(|entry| Artifact::read(results, &entry.name).ok());
    let measured: Vec<(Artifact, Rows)> = measured.filter_map(|a| a.parse().ok().map(|rows| (a, rows))).collect();
    let mut lines = Vec::new();
    for folder in shipped::folders(models, "")? {
        let (config, input) = (ModelConfig::read(&folder)?, Input::model(&folder)?);
        if config.truth == Truth::Paper.name() || config.network.architecture == Architecture::Chain {
            continue;
        }
        let own = measured.iter().filter(|(result, _)| result.inputs.0.contains(&input)).flat_map(|(_, rows)| &rows.rows);
        let own = own.filter(|row| row.model.as_ref() == Some(&input.name())).filter_map(|row| row.verdict.as_ref());
        let own: Vec<&Verdict> = own.collect();
        if own.is_empty() {
            lines.push(format!("{}: no result has a verdict on these weights; `cargo xtask results make passive` does", input.name()));
        }
        let short = |v: &&Verdict| Some(format!("{} in {}: {}", input.name(), v.scene, v.shortfall()?));
        lines.extend(own.iter().find_map(short));
    }
    Ok(lines)
}
