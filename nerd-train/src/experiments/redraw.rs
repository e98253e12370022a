//! Tables and pictures of a record anew, from what was measured then.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::Value;

use super::Experiment;
use super::ablations::Ablated;
use super::calibrated::CalibratedAll;
use super::stability::{Stability, StabilityMap};
use super::sweep::Swept;
use crate::error::{Error, Result, refuse};
use crate::report::artifact::Head;
use crate::report::write;

/// Whether [`redraw`] knows results of this name.
pub fn drawn(name: &str) -> bool {
    name == "ablations" || ["sweep-", "calibrate-", "stability"].iter().any(|kind| name.starts_with(kind))
}

/// Writes `NAME.md`, the tables of `NAME.json` and its pictures anew; what was measured, and where it comes from, stays as it is.
/// For sweeps and ablations, which cannot be measured again in a day, for calibrations, whose logs are not everybody's, and for stability maps,
/// one of which needs a GPU.
///
/// # Errors
/// If there is no such record, or its files cannot be written.
pub fn redraw(folder: &Path, name: &str) -> Result<()> {
    match name {
        "ablations" => again(folder, name, |data: &Ablated| data.settings.clone()),
        _ if name.starts_with("calibrate-") => again(folder, name, |data: &CalibratedAll| data.settings.clone()),
        _ if name.starts_with("stability") => again(folder, name, |_: &StabilityMap| Stability::recorded(name)),
        _ if drawn(name) => again(folder, name, |data: &Swept| data.settings.clone()),
        _ => refuse!("{name}: only sweeps, ablations, calibrations and stability maps are drawn from their data; measure it again"),
    }
}

fn again<E: Experiment>(folder: &Path, name: &str, experiment: impl Fn(&E::Data) -> E) -> Result<()>
where
    E::Data: DeserializeOwned,
{
    let mut head = Head::read(folder, name)?;
    let path = folder.join(format!("{name}.json"));
    let data: E::Data = serde_json::from_value(Value::Object(head.data.clone())).map_err(Error::format(&path))?;
    let experiment = experiment(&data);
    head.tables = experiment.tables(&data)?;
    let text = nerd_sim::files::read_text(&path).map_err(Error::file(&path))?;
    let tables = serde_json::to_string_pretty(&head.tables).map_err(Error::format(&path))?;
    let Some(text) = with_tables(&text, &tables) else { return Err(Error::format(&path)("no list `tables`, indented by two spaces")) };
    write(&path, text.as_bytes())?;
    write(&path.with_extension("md"), head.markdown().as_bytes())?;
    experiment.pictures(&data, &folder.join(name))
}

/// The text of a record with other tables: numbers that are read and written again may differ in their last digit.
fn with_tables(text: &str, tables: &str) -> Option<String> {
    const KEY: &str = "\n  \"tables\": [";
    let (before, rest) = text.split_once(KEY)?;
    let behind = rest.strip_prefix(']').or_else(|| rest.split_once("\n  ]").map(|(_, behind)| behind))?;
    let list = tables.trim_start_matches('[').replace('\n', "\n  ");
    Some(format!("{before}{KEY}{list}{behind}"))
}
