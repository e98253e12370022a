//! What changed since the last committed results: figures with a standard error, against that.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::html::{Section, table};
use crate::error::Result;
use crate::report::table::digits;
use crate::report::{Manifest, Table};

/// Standard errors apart that two measurements must lie to be called different.
const APART: f64 = 3.0;

/// Of every result the version before: the committed one, or, if that is the one in the folder, the one committed before it.
pub fn section(manifest: &Manifest, results: &Path) -> Result<Section> {
    let mut section = Section::new(
        "Changes",
        "Figures that differ from those of the results before by more than three standard errors of the difference. The results before are \
         the last committed ones, or, where these are shown here, those committed before them.",
    );
    let mut rows = Vec::new();
    let mut compared = 0;
    for entry in &manifest.artefact {
        let file = format!("{}.json", entry.name);
        let Some((now, then)) =
            std::fs::read_to_string(results.join(&file)).ok().and_then(|text| Some((parse(&text)?, before(results, &file, &text)?)))
        else {
            continue;
        };
        let (now, then) = (counted(figures(&now, "")), counted(figures(&then, "")));
        for (at, value, error) in &now {
            let Some((_, old, old_error)) = then.iter().find(|(other, ..)| other == at) else { continue };
            compared += 1;
            let spread = error.hypot(*old_error);
            if (value - old).abs() > APART * spread {
                let word = if value < old { "smaller" } else { "larger" };
                let cells = [&entry.name, &at.0, &digits(*old), &digits(*value), &digits(spread), word];
                rows.push(cells.map(ToString::to_string).to_vec());
            }
        }
    }
    section.body = match rows.is_empty() {
        true => format!("<p>None of {compared} compared figures.</p>"),
        false => table(&Table::new("changes", &["result", "figure", "before", "now", "standard error", "now it is"]).with(rows)),
    };
    Ok(section)
}

/// The file as it was committed last, unless that is this very text; then the one before.
fn before(results: &Path, file: &str, text: &str) -> Option<Value> {
    let git = |args: &[&str]| {
        let done =
            Command::new("git").arg("-C").arg(if results.as_os_str().is_empty() { Path::new(".") } else { results }).args(args).output();
        done.ok().filter(|o| o.status.success()).map(|o| String::from_utf8_lossy(&o.stdout).into_owned())
    };
    let commits = git(&["log", "-n", "2", "--format=%H", "--", file])?;
    commits.lines().filter_map(|commit| git(&["show", &format!("{commit}:./{file}")])).find(|old| old != text).and_then(|old| parse(&old))
}

fn parse(text: &str) -> Option<Value> {
    serde_json::from_str(text).ok()
}

/// Several figures may be called the same; then they are told apart by their order.
fn counted(figures: Vec<(String, f64, f64)>) -> Vec<((String, usize), f64, f64)> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut count = |at: String| {
        let n = seen.entry(at.clone()).or_default();
        *n += 1;
        (at, *n)
    };
    figures.into_iter().map(|(at, value, error)| (count(at), value, error)).collect()
}

/// Numbers that stand beside their standard errors, with where they stand.
fn figures(value: &Value, at: &str) -> Vec<(String, f64, f64)> {
    let mut found = Vec::new();
    match value {
        Value::Object(map) => {
            for (value, error) in [("error", "standard_error"), ("mean", "standard_error")] {
                if let (Some(value), Some(error)) = (map.get(value), map.get(error)) {
                    let numbers = |v: &Value| v.as_array().cloned().unwrap_or_else(|| vec![v.clone()]);
                    let pairs = numbers(value).into_iter().zip(numbers(error)).enumerate();
                    found.extend(pairs.filter_map(|(k, (x, e))| Some((format!("{at} [{k}]"), x.as_f64()?, e.as_f64()?))));
                }
            }
            found.extend(map.iter().flat_map(|(key, inner)| figures(inner, &format!("{at} {key}"))));
        }
        Value::Array(all) => {
            for (k, inner) in all.iter().enumerate() {
                let words =
                    ["robot", "scene", "method", "truth", "name", "task", "policy", "model"].iter().filter_map(|key| inner[*key].as_str());
                let name = words.collect::<Vec<_>>().join(" ");
                found.extend(figures(inner, &if name.is_empty() { format!("{at} {k}") } else { name }));
            }
        }
        _ => {}
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_one_name_are_told_apart() {
        let named = |x| ("ant".to_string(), x, 0.1);
        let found = counted(vec![named(1.0), named(2.0)]);
        assert_eq!(found.iter().map(|(at, ..)| at.1).collect::<Vec<_>>(), [1, 2], "{found:?}");
    }

    #[test]
    fn figures_are_found_beside_their_standard_errors() {
        let data = serde_json::json!({ "rows": [{ "robot": "ant", "report": { "error": [1.0, 2.0], "standard_error": [0.1, 0.2] } }] });
        let found = figures(&data, "");
        assert_eq!(found, [("ant report [0]".into(), 1.0, 0.1), ("ant report [1]".into(), 2.0, 0.2)]);
    }
}
