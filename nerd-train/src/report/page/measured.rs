//! Real motion and its predictions.

use std::path::Path;

use serde_json::Value;

use super::html::{Section, from, motion, table};
use super::robots::picture;
use crate::error::{Error, Result};
use crate::experiments::calibrated::CalibratedAll;
use crate::report::Manifest;
use crate::report::artifact::Head;
use crate::report::replay::escape;

/// Calibrations to measured trajectories, each with some of these in motion.
pub fn section(manifest: &Manifest, results: &Path) -> Result<Section> {
    let mut section = Section::new(
        "Measured",
        "Real motion solid, predictions from its start as ghosts. Nothing was fitted to the trajectories that are shown.",
    );
    for entry in manifest.artefact.iter().filter(|e| e.name.starts_with("calibrate-")) {
        let Ok(head) = Head::read(results, &entry.name) else { continue };
        let path = results.join(format!("{}.json", entry.name));
        let data: CalibratedAll = serde_json::from_value(Value::Object(head.data.clone())).map_err(Error::format(&path))?;
        section.body += &format!("<h3>{}</h3>", escape(&entry.about));
        section.body += &head.tables.iter().filter(|t| t.name == "errors").map(table).collect::<String>();
        section.body += &picture(results, &format!("{}-frames", entry.name), "How the error grows");
        let cards: String =
            data.replays()?.iter().map(|r| format!("<div class=card><h3>{}</h3>{}</div>", escape(&r.title), motion(r))).collect();
        section.body += &format!("<div class=cards>{cards}</div>{}", from(&entry.name, &head.provenance));
    }
    Ok(section)
}
