//! One page where a person sees everything: the results as they stand in a folder, and motions made on the spot. It loads
//! nothing, so it can be sent and kept.

mod html;
mod robots;

use std::path::Path;

use serde_json::Value;

use super::artifact::Head;
use super::{Manifest, replay, write};
use crate::error::Result;
use html::{Section, from, table};
use nerd_train::progress::Bar;

pub use robots::{CARDS, TASKS};

const PAGE: &str = include_str!("../page.html");
const STYLE: &str = include_str!("../page.css");
const SCRIPT: &str = include_str!("../page.js");

/// Settings of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageConfig {
    /// Frames of a passive motion.
    pub frames: usize,
    /// Steps of an episode.
    pub steps: usize,
}

impl Default for PageConfig {
    fn default() -> Self {
        Self { frames: 240, steps: 300 }
    }
}

/// Motions that a page of this workspace shows, for a bar's total.
pub fn motions() -> usize {
    CARDS.len() + TASKS.len()
}

/// Writes the page of the results in a folder; `bar` counts [`motions`].
///
/// # Errors
/// If a result, model or policy that it shows cannot be read, a motion cannot be made, or the file cannot be written.
pub fn page(config: &PageConfig, results: &Path, out: &Path, bar: &Bar) -> Result<()> {
    let manifest = Manifest::read(results)?;
    let mut sections = vec![scorecard(results)?, robots::cards(config, results, bar)?, charts(&manifest, results)?];
    sections.extend([stability(&manifest, results)?, robots::policies(config, results, bar)?]);
    sections.extend([everything(&manifest, results)]);
    let links: Vec<String> = sections.iter().map(Section::link).collect();
    let body: String = sections.iter().map(Section::html).collect();
    let script = format!("{}\n{SCRIPT}", replay::SCRIPT);
    let page = PAGE.replace("STYLE", STYLE).replace("NAVIGATION", &links.join("")).replace("SCRIPT", &script).replace("BODY", &body);
    write(out, page.as_bytes())
}

/// What the paper reports, beside ours.
fn scorecard(results: &Path) -> Result<Section> {
    let mut section =
        Section::new("Scorecard", "Ours beside the figures of the paper, motion and policies. Smaller errors, gaps nearer to 0.");
    for name in ["passive", "policies"] {
        if let Ok(head) = Head::read(results, name) {
            let shown = head.tables.iter().find(|t| t.name == "summary").or(head.tables.first());
            section.body += &shown.map(table).unwrap_or_default();
            section.body += &from(name, &head.provenance);
        }
    }
    Ok(section)
}

/// Speed against accuracy, a chart for each scene that has one.
fn charts(manifest: &Manifest, results: &Path) -> Result<Section> {
    let mut section = Section::new(
        "Speed and accuracy",
        "Each point is a solver at one setting: point at it, and it says which. Lower and further left is better; points with a rim are \
         beaten by none in both. Errors are distances from a converged motion.",
    );
    for entry in manifest.artefact.iter().filter(|e| e.name.starts_with("chart-")) {
        let Ok(head) = Head::read(results, &entry.name) else { continue };
        let keep = |key: &str| head.data.get(key).cloned().unwrap_or(Value::Null);
        let data = serde_json::json!({ "points": keep("points"), "hold": keep("hold") });
        section.body += &format!("<div class=card><h3>{}</h3>", replay::escape(&entry.about));
        section.body += &format!("<div class=chart><script type=application/json>{}</script></div>", replay::script(&data));
        section.body += &format!("{}</div>", from(&entry.name, &head.provenance));
    }
    section.body = format!("<div class=cards>{}</div>", section.body);
    Ok(section)
}

/// The map of known answers: what each row asks, why, and what came out.
fn stability(manifest: &Manifest, results: &Path) -> Result<Section> {
    let mut section = Section::new(
        "Stability",
        "Scenes with known answers. Green is within the limit, yellow within ten times, red beyond, or the solver gave up. Limits come \
         from equations and other people's tests.",
    );
    for entry in manifest.artefact.iter().filter(|e| e.name.starts_with("stability")) {
        let Ok(head) = Head::read(results, &entry.name) else { continue };
        let text = |value: &Value| value.as_str().map_or_else(String::new, replay::escape);
        let list = |value: Option<&Value>| value.and_then(Value::as_array).cloned().unwrap_or_default();
        let methods: String = list(head.data.get("methods")).iter().map(|m| format!("<th>{}</th>", text(m))).collect();
        let mut rows = String::new();
        for row in list(head.data.get("rows")) {
            let cells = list(row.get("cells"));
            let cell = |c: &Value| {
                let figure = c["figure"].as_f64().map_or_else(|| "-".into(), super::table::digits);
                format!("<td class={}>{figure}{}</td>", text(&c["verdict"]), if c["lost"].is_string() { " lost" } else { "" })
            };
            let limit = row["limit"].as_f64().map_or_else(String::new, super::table::digits);
            let why = [&row["why"], &row["source"]].map(text).join(" ");
            let asked = [text(&row["figure"]), row["unit"].as_str().map_or_else(String::new, |u| format!(" ({u})"))].concat();
            let cells: String = cells.iter().map(cell).collect();
            rows += &format!("<tr><td>{}</td><td>{asked}</td><td>{}</td><td>{limit}</td>{cells}</tr>", text(&row["row"]), why.trim());
        }
        let open = if entry.name == "stability" { " open" } else { "" };
        section.body += &format!(
            "<details{open}><summary>{}</summary><div class=wide><table class='sorts map'><thead><tr><th>row</th><th>asks</th><th>why</th>\
             <th>limit</th>{methods}</tr></thead><tbody>{rows}</tbody></table></div>{}</details>",
            replay::escape(&entry.about),
            from(&entry.name, &head.provenance)
        );
    }
    Ok(section)
}

/// Every result with its tables, its state and where it comes from.
fn everything(manifest: &Manifest, results: &Path) -> Section {
    let mut section = Section::new("All results", "Every result that the repository keeps, with the command that makes it.");
    for entry in &manifest.artefact {
        let status = entry.status(results);
        let head = Head::read(results, &entry.name);
        let tables: String = head.iter().flat_map(|h| &h.tables).map(table).collect();
        let origin = head.iter().map(|h| from(&entry.name, &h.provenance)).collect::<String>();
        let colour = if status.holds() { "better" } else { "worse" };
        section.body += &format!(
            "<details><summary><b>{}</b>: {} <span class={colour}>({})</span></summary>{tables}{origin}</details>",
            replay::escape(&entry.name),
            replay::escape(&entry.about),
            replay::escape(&status.to_string())
        );
    }
    section
}
