//! Tables and pictures of a record anew, from what was measured then.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::Value;

use super::Experiment;
use super::ablations::Ablated;
use super::sweep::Swept;
use crate::error::{Error, Result, refuse};
use crate::report::artifact::Head;

/// Writes `NAME.md`, the tables of `NAME.json` and its pictures anew; what was measured, and where it comes from, stays as it is.
/// For sweeps and ablations, which cannot be measured again in a day.
///
/// # Errors
/// If there is no such record, or its files cannot be written.
pub fn redraw(folder: &Path, name: &str) -> Result<()> {
    match name {
        "ablations" => again(folder, name, |data: &Ablated| data.settings.clone()),
        _ if name.starts_with("sweep-") => again(folder, name, |data: &Swept| data.settings.clone()),
        _ => refuse!("{name}: only sweeps and ablations are drawn from their data; measure it again"),
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
    head.write(folder, name)?;
    experiment.pictures(&data, &folder.join(name))
}
