//! A result as a folder: provenance, inputs, tables and data.

use nerd_train::{shipped::results, words::markdown};
use serde_json::{Map, Value};

use super::{Provenance, names, read_json, write_json};
use crate::prelude::*;
use nerd_sim::files::{has_keys, unclaimed};

/// A result. In JSON, the entries of `data` stand beside the other fields.
#[derive(Serialize, Deserialize)]
pub struct Artifact {
    pub provenance: Provenance,
    #[serde(default)]
    pub inputs: Inputs,
    /// Size of the measurement, such as rollouts times frames. A result is replaced only by a result of at least this
    /// effort.
    #[serde(default)]
    pub effort: f64,
    #[serde(default)]
    pub tables: Vec<Table>,
    #[serde(flatten)]
    pub data: Map<String, Value>,
}

pub fn file(folder: &Path, name: &str) -> PathBuf {
    folder.join(name).join("result.json")
}

impl Artifact {
    pub fn read(folder: &Path, name: &str) -> Result<Self> {
        read_json(&file(folder, name))
    }

    pub fn parse<T: DeserializeOwned>(&self) -> Result<T> {
        Ok(serde_json::from_value(Value::Object(self.data.clone()))?)
    }

    pub fn table(&self, name: &str) -> Option<&Table> {
        self.tables.iter().find(|table| table.name == name)
    }

    /// Writes `NAME/result.json`, and the tables as `NAME/README.md`, into a folder.
    pub fn write(&self, folder: &Path, name: &str) -> Result<()> {
        may_write(folder, name, &self.provenance, self.effort)?;
        let path = file(folder, name);
        // Writes `result.json` first: it marks the folder as a result of this project.
        write_json(&path, self)?;
        if !self.tables.is_empty() {
            let tables = self.tables.iter().map(Table::markdown).collect_vec();
            write(
                &path.with_file_name("README.md"),
                format!("{}\n{}\n", tables.join("\n"), self.provenance).as_bytes(),
            )?;
        }
        Ok(())
    }
}

/// Refuses to replace a result by a weaker one; call it before measuring. Weaker means less effort. In the project's
/// own folder, a checkout with changed files is also weaker than a clean one.
pub fn may_write(folder: &Path, name: &str, provenance: &Provenance, effort: f64) -> Result<()> {
    if name.is_empty() || name.starts_with('.') || name.contains(['/', '\\']) {
        bail!("--name `{name}`: a result's folder is named by letters and digits; --out says where it is");
    }
    let path = file(folder, name);
    if let Some(taken) = path.ancestors().skip(1).find(|place| place.is_file()) {
        bail!("--out: {}: is a file, not a folder", taken.display());
    }
    let Ok(there) = Artifact::read(folder, name) else {
        let own = folder.join(name);
        let there = names(&own);
        let names = there.iter().map(String::as_str).filter(|name| !name.starts_with('.')).collect_vec();
        return unclaimed(&own, &names, || has_keys(&path, &["provenance", "inputs"])).context("--out");
    };
    if effort < there.effort {
        bail!(
            "{}: of {} episodes or rollout frames, this run has {effort}; ask for as many (--episodes, --trajectories, \
             --frames), or write elsewhere (--out out/try)",
            path.display(),
            there.effort
        );
    }
    let own =
        || folder.canonicalize().is_ok_and(|folder| results().canonicalize().is_ok_and(|results| results == folder));
    if provenance.dirty() && !there.provenance.dirty() && own() {
        bail!("{}: of a clean checkout; commit your changes first, or write elsewhere (--out out/try)", path.display());
    }
    Ok(())
}

/// A table of rows under a header. Cells are text for readers; exact numbers are in the result's data.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Table {
    /// One word by which documents refer to the table.
    pub name: String,
    /// Text below the table: protocol, units.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    pub header: Vec<String>,
    /// Rows, each with one cell for each column.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new(name: &str, header: impl IntoIterator<Item = impl ToString>) -> Self {
        let header = header.into_iter().map(|column| column.to_string()).collect();
        Self { name: name.into(), header, ..Self::default() }
    }

    /// Sets the rows; replaces characters that would end a Markdown cell or line.
    pub fn with(mut self, rows: impl IntoIterator<Item: IntoIterator<Item = String>>) -> Self {
        let cell = |text: String| text.replace('|', "/").split('\n').map(str::trim).join(" ");
        self.rows = rows.into_iter().map(|row| row.into_iter().map(cell).collect()).collect();
        self
    }

    /// Adds a column with a cell for each row.
    pub fn column(&mut self, name: &str, cells: impl Iterator<Item = String>) {
        self.header.push(name.into());
        self.rows.iter_mut().zip(cells).for_each(|(row, cell)| row.push(cell));
    }

    pub fn noted(mut self, note: impl Into<String>) -> Self {
        self.note = note.into();
        self
    }

    /// Writes an aligned Markdown table with its note below.
    pub fn markdown(&self) -> String {
        let header = self.header.iter().map(String::as_str).collect_vec();
        let note = if self.note.is_empty() { String::new() } else { format!("\n{}\n", self.note) };
        markdown(&header, &self.rows) + &note
    }

    /// Converts rows to JSON objects. The first column holds names. In a column of numbers alone, `2.1` becomes a
    /// number. `1.2 / 3.4`, `1.2 +- 3.4` and `1.2 ± 3.4` become lists; `-` and non-finite values become null. A cell
    /// with words, such as `under 0.01`, makes its whole column text.
    pub fn json(&self) -> Value {
        let counts = |k: usize| k > 0 && self.rows.iter().all(|row| row[k] == "-" || numbers(&row[k]).is_some());
        let counts = (0..self.header.len()).map(counts).collect_vec();
        let cell = |cell: &String, counts: bool| match numbers(cell) {
            _ if !counts => cell.clone().into(),
            Some(one) if one.len() == 1 => one[0].into(),
            several => several.into(),
        };
        let object = |row: &Vec<String>| {
            self.header.iter().cloned().zip(row.iter().zip(&counts).map(|(c, k)| cell(c, *k))).collect()
        };
        Value::Array(self.rows.iter().map(|row| Value::Object(object(row))).collect())
    }
}

/// Parses a cell's numbers; `None` for text, such as the name `007`.
fn numbers(cell: &str) -> Option<Vec<f64>> {
    let number = |part: &str| {
        let digits = part.trim_start_matches(['+', '-']).as_bytes();
        let printed =
            matches!(digits, [b'0'] | [b'0', b'.', ..] | [b'1'..=b'9', ..]) || ["NaN", "inf", "-inf"].contains(&part);
        part.parse().ok().filter(|_| printed)
    };
    cell.split(" / ").flat_map(|part| part.split(" +- ")).flat_map(|part| part.split(" ± ")).map(number).collect()
}

/// Returns the cell's text, or a dash for `None`.
pub fn or_dash(cell: Option<impl ToString>) -> String {
    cell.map_or_else(|| "-".into(), |cell| cell.to_string())
}
