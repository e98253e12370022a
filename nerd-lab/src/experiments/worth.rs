//! Whether shipped models are worth their networks ([`Verdict`]).

use nerd_cli::experiments::passive::Rows;
use nerd_cli::report::Artifact;
use nerd_model::transformer::Architecture;
use nerd_train::verdict::Verdict;

use crate::{prelude::*, report::Manifest};

/// Lists shipped models that have no verdict, or a scene in which they are not worth their network. Models of the
/// reference simulator (taken as in the paper) and cables (no linear map) are left out.
pub fn unworthy(manifest: &Manifest, results: &Path, models: &Path) -> Result<Vec<String>> {
    let measured = manifest.artefact.iter().filter_map(|entry| Artifact::read(results, &entry.name).ok());
    let measured: Vec<(Artifact, Rows)> = measured.filter_map(|a| a.parse().ok().map(|rows| (a, rows))).collect();
    let mut lines = Vec::new();
    for folder in shipped::folders(models, "")? {
        let config = ModelConfig::read(&folder)?;
        let input = Input::model(&folder)?;
        if config.truth == Truth::Paper.name() || config.network.architecture == Architecture::Chain {
            continue;
        }
        let own =
            measured.iter().filter(|(result, _)| result.inputs.0.contains(&input)).flat_map(|(_, rows)| &rows.rows);
        let own = own.filter(|row| row.model.as_ref() == Some(&input.name())).filter_map(|row| row.verdict.as_ref());
        let own = own.collect_vec();
        if own.is_empty() {
            lines.push(format!(
                "{}: no result has a verdict on these weights; `cargo xtask results make passive` does",
                input.name()
            ));
        }
        let short = |v: &&Verdict| Some(format!("{} in {}: {}", input.name(), v.scene, v.shortfall()?));
        lines.extend(own.iter().find_map(short));
    }
    Ok(lines)
}
