//! HTML parts of the report page.

use std::path::Path;

use nerd_cli::report::{Artifact, Provenance, Table};
use nerd_train::replay::{Replay, escape, script};

/// A titled section of the page, and the link to it.
pub struct Section {
    pub link: String,
    pub html: String,
}

impl Section {
    pub fn new(title: &str, lead: &str, body: &str) -> Self {
        let anchor = title.to_lowercase().replace(' ', "-");
        let html = format!("<section id=\"{anchor}\"><h2>{title}</h2><p>{lead}</p>{body}</section>\n");
        Self { link: format!("<a href=\"#{anchor}\">{title}</a>"), html }
    }
}

/// Renders a table as HTML whose rows are sorted by clicking a column.
pub fn table(table: &Table) -> String {
    let row =
        |cells: &[String], tag: &str| cells.iter().map(|c| format!("<{tag}>{}</{tag}>", escape(c))).collect::<String>();
    let rows: String = table.rows.iter().map(|r| format!("<tr>{}</tr>", row(r, "td"))).collect();
    let note = if table.note.is_empty() { String::new() } else { format!("<p class=from>{}</p>", escape(&table.note)) };
    let head = row(&table.header, "th");
    format!(
        "<div class=wide><table class=sorts><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>{note}"
    )
}

pub fn from(name: &str, provenance: &Provenance) -> String {
    format!("<p class=from>results/{}: {}</p>", escape(name), escape(&provenance.to_string().replace('`', "")))
}

/// Renders the named tables of a result, and its provenance; empty if the result is missing.
pub fn result(results: &Path, name: &str, tables: &[&str]) -> String {
    let Ok(result) = Artifact::read(results, name) else { return String::new() };
    let shown: String = tables.iter().filter_map(|name| result.table(name)).map(table).collect();
    shown + &from(name, &result.provenance)
}

pub fn folded(title: &str, body: &str) -> String {
    format!("<details><summary>{title}</summary>{body}</details>")
}

pub fn picture(results: &Path, file: &str) -> String {
    let svg = std::fs::read_to_string(results.join(file)).unwrap_or_default();
    if svg.is_empty() { svg } else { format!("<div class=picture>{svg}</div>") }
}

/// Renders a replay that plays while visible, with the HTML `more` below it.
pub fn card(name: &str, replay: &Replay, more: &str) -> String {
    let motion = format!("<div class=motion><script type=application/json>{}</script></div>", script(replay));
    format!("<div class=card><h3>{name}</h3>{motion}{more}</div>")
}
