//! Pieces of the page.

use crate::report::replay::{Replay, escape};
use crate::report::{Provenance, Table};

/// A part of the page under a heading.
pub struct Section {
    title: &'static str,
    lead: &'static str,
    /// HTML.
    pub body: String,
}

impl Section {
    /// Without a body yet.
    pub fn new(title: &'static str, lead: &'static str) -> Self {
        Self { title, lead, body: String::new() }
    }

    fn anchor(&self) -> String {
        self.title.to_lowercase().replace(' ', "-")
    }

    /// For the line of links.
    pub fn link(&self) -> String {
        format!("<a href=\"#{}\">{}</a>", self.anchor(), self.title)
    }

    /// With its heading.
    pub fn html(&self) -> String {
        format!("<section id=\"{}\"><h2>{}</h2><p>{}</p>{}</section>\n", self.anchor(), self.title, self.lead, self.body)
    }
}

/// A table that sorts by the column that is clicked.
pub fn table(table: &Table) -> String {
    let row = |cells: &[String], tag: &str| cells.iter().map(|c| format!("<{tag}>{}</{tag}>", escape(c))).collect::<String>();
    let rows: String = table.rows.iter().map(|r| format!("<tr>{}</tr>", row(r, "td"))).collect();
    let note = if table.note.is_empty() { String::new() } else { format!("<p class=from>{}</p>", escape(&table.note)) };
    let head = row(&table.header, "th");
    format!("<div class=wide><table class=sorts><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>{note}")
}

/// Where a figure comes from.
pub fn from(name: &str, provenance: &Provenance) -> String {
    format!("<p class=from>results/{}.json: {}</p>", escape(name), escape(&provenance.to_string().replace('`', "")))
}

/// A replay that starts when it is seen.
pub fn motion(replay: &Replay) -> String {
    format!("<div class=motion><script type=application/json>{}</script></div>", replay.json())
}
