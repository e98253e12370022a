//! The learning curve of a run: mean reward and mean length of episodes by step.

use std::path::Path;

use super::Iteration;
use crate::error::{Error, Result};

/// Points that a shipped curve has, about.
const POINTS: usize = 100;

/// Writes `curve.csv` for a run's policy: steps, mean reward and mean length of episodes, thinned out.
pub(super) fn write(out: &Path, folder: &Path) -> Result<()> {
    let metrics = out.join("metrics.jsonl");
    let lines = std::fs::read_to_string(&metrics).map_err(Error::file(&metrics))?;
    let lines: Vec<Iteration> = lines.lines().map(serde_json::from_str).collect::<Result<_, _>>().map_err(Error::format(&metrics))?;
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
