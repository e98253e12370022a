//! Numbers and tables in documents: marks name a result, and a command fills in its values.
//!
//! ```text
//! <!--= ant-2048 /rows/0/report/error/0 -->0.0145<!--/-->     a number
//! <!-- table passive summary -->                              a table of a result
//! | robot | ..
//! <!-- /table -->
//! ```

use nerd_cli::report::Artifact;
use serde_json::Value;

use super::below;
use crate::prelude::*;

const FIGURE: (&str, &str) = ("<!--= ", "<!--/-->");
const TABLE: (&str, &str) = ("<!-- table ", "<!-- /table -->");

pub struct Marks {
    folder: PathBuf,
    read: BTreeMap<String, (Artifact, Value)>,
}

impl Marks {
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.into(), read: BTreeMap::new() }
    }

    /// Returns a document with all marked numbers and tables filled in from the results.
    pub fn fill(&mut self, text: &str) -> Result<String> {
        let figures = between(text, FIGURE, |mark| self.figure(mark))?;
        between(&figures, TABLE, |mark| self.table(mark))
    }

    fn result(&mut self, name: &str) -> Result<&(Artifact, Value)> {
        if !self.read.contains_key(name) {
            let head = Artifact::read(&self.folder, name)?;
            let whole = serde_json::to_value(&head)?;
            self.read.insert(name.into(), (head, whole));
        }
        Ok(&self.read[name])
    }

    fn figure(&mut self, mark: &str) -> Result<String> {
        let Some((name, pointer)) = mark.split_once(' ') else {
            bail!("`{mark}`: a result and a JSON pointer are needed")
        };
        match self.result(name)?.1.pointer(pointer).map(Value::as_f64) {
            Some(Some(x)) => Ok(digits(x)),
            Some(None) => bail!("`{mark}`: no number is there"),
            None => bail!("`{mark}`: results/{name}/result.json has no {pointer}"),
        }
    }

    fn table(&mut self, mark: &str) -> Result<String> {
        let Some((name, table)) = mark.split_whitespace().collect_tuple() else {
            bail!("`{mark}`: a result and one of its tables are needed")
        };
        let (head, _) = self.result(name)?;
        match head.table(table) {
            Some(table) => Ok(format!("\n{}", table.markdown())),
            None => {
                let known = head.tables.iter().map(|t| &t.name).join(", ");
                bail!("`{mark}`: results/{name}/result.json has no such table, but {known}")
            }
        }
    }
}

/// Replaces the text between `open MARK -->` and `close` by `fill(MARK)`.
fn between(text: &str, (open, close): (&str, &str), mut fill: impl FnMut(&str) -> Result<String>) -> Result<String> {
    let mut done = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(open) {
        let (before, after) = rest.split_at(at);
        let end = after.find("-->").zip(after.find(close)).filter(|(a, b)| a < b);
        let Some((mark, stop)) = end else {
            bail!("a mark is not closed: {}", after.lines().next().unwrap_or_default())
        };
        done += before;
        done += &after[..mark + 3];
        done += &fill(after[open.len()..mark].trim())?;
        done += close;
        rest = &after[stop + close.len()..];
    }
    Ok(done + rest)
}

pub fn documents(root: &Path) -> Vec<PathBuf> {
    let mut found = below(&root.join("docs")).unwrap_or_default();
    found.retain(|path| path.extension().is_some_and(|e| e == "md"));
    found.extend(["README.md", "ARCHITECTURE.md"].map(|name| root.join(name)).into_iter().filter(|path| path.exists()));
    found.sort();
    found
}

/// Finds decimal numbers of a document whose source is unknown: those outside marks, code and links. Returns (line,
/// number).
pub fn unmarked(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut fenced = false;
    let mut table = false;
    for (number, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        table = (table || line.contains(TABLE.0)) && !line.contains(TABLE.1);
        if !fenced && !table {
            found.extend(decimals(&bare(line)).into_iter().map(|figure| (number + 1, figure)));
        }
    }
    found
}

/// Removes marked numbers, comments, code and link targets from a line.
fn bare(line: &str) -> String {
    let mut line = line.to_string();
    for (open, close) in [FIGURE, ("<!--", "-->"), ("`", "`"), ("](", ")"), ("https://", " ")] {
        while let Some(at) = line.find(open) {
            let end = line[at + open.len()..].find(close).map_or(line.len(), |n| at + open.len() + n + close.len());
            line.replace_range(at..end, " ");
        }
    }
    line
}

fn decimals(line: &str) -> Vec<String> {
    let words = line.split(|c: char| !(c.is_ascii_digit() || c == '.'));
    let decimal = |word: &&str| {
        word.split_once('.').is_some_and(|(a, b)| {
            !b.is_empty() && b.bytes().all(|c| c.is_ascii_digit()) && a.bytes().all(|c| c.is_ascii_digit())
        })
    };
    words.map(|word| word.trim_end_matches('.')).filter(decimal).map(String::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_no_mark_and_no_code_explains_is_found() {
        let text = "It errs by <!--= x /y -->0.5<!--/--> rad, in `0.2` or [a](b0.3) or 0.25 s, 1.5.\n```\n0.7\n```\n<!-- table a b -->\n| 0.1 |\n<!-- /table -->\n.4\n";
        let found: Vec<String> = unmarked(text).into_iter().map(|(line, figure)| format!("{line}:{figure}")).collect();
        assert_eq!(found, ["1:0.25", "1:1.5", "8:.4"]);
    }

    #[test]
    fn what_stands_between_marks_is_replaced_and_the_marks_stay() {
        let filled =
            between("a <!--= x /y -->old<!--/--> b <!--= z /w -->old<!--/-->", FIGURE, |mark| Ok(mark.to_uppercase()))
                .expect("closed");
        assert_eq!(filled, "a <!--= x /y -->X /Y<!--/--> b <!--= z /w -->Z /W<!--/-->");
        assert!(between("<!--= x /y -->1", FIGURE, |_| Ok(String::new())).is_err(), "an open mark was filled");
    }
}
