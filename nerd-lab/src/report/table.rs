//! Tables for the terminal, for Markdown, for JSON and for pages.

use nerd_train::words::markdown;
use serde::{Deserialize, Serialize};

/// Rows under a header. Cells are text as a person reads it; the numbers are in the artefact's data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// One word, by which documents name it.
    pub name: String,
    /// What the columns do not say: protocol, units.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    pub header: Vec<String>,
    /// As many cells each as there are columns.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new(name: &str, header: &[&str]) -> Self {
        Self { name: name.into(), header: header.iter().map(ToString::to_string).collect(), ..Self::default() }
    }

    /// What would end a cell or a line in one is written otherwise.
    pub fn with(mut self, rows: impl IntoIterator<Item = Vec<String>>) -> Self {
        let cell = |text: String| text.replace('|', "/").split('\n').map(str::trim).collect::<Vec<_>>().join(" ");
        self.rows = rows.into_iter().map(|row| row.into_iter().map(cell).collect()).collect();
        self
    }

    pub fn noted(mut self, note: &str) -> Self {
        self.note = note.into();
        self
    }

    /// As an aligned Markdown table, its note below.
    pub fn markdown(&self) -> String {
        let header: Vec<&str> = self.header.iter().map(String::as_str).collect();
        let note = if self.note.is_empty() { String::new() } else { format!("\n{}\n", self.note) };
        markdown(&header, &self.rows) + &note
    }

    pub fn json(&self) -> serde_json::Value {
        let object = |row: &Vec<String>| self.header.iter().cloned().zip(row.iter().map(|c| c.clone().into())).collect();
        serde_json::Value::Array(self.rows.iter().map(|row| serde_json::Value::Object(object(row))).collect())
    }
}

/// A cell, or a dash where there is nothing.
pub fn or_dash(cell: Option<impl ToString>) -> String {
    cell.map_or_else(|| "-".into(), |cell| cell.to_string())
}
