//! CSV files whose columns are found by name, in any order. Errors name file, line and column.

use std::{collections::HashSet, fs::File, hash::Hash};

use csv::StringRecord;

use crate::internal::*;

/// How far a quaternion's length may be from 1: digits are cut in files.
const UNIT: f64 = 1e-3;

pub(crate) struct Table {
    path: PathBuf,
    pub names: Vec<String>,
    reader: csv::Reader<File>,
}

impl Table {
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let mut reader = csv::Reader::from_path(path).map_err(|e| FileError::new(path, format!("cannot read it: {e}")))?;
        let header = reader.headers().map_err(|e| FileError::new(path, e))?;
        Ok(Self { path: path.into(), names: header.iter().map(|name| name.trim().to_string()).collect(), reader })
    }

    /// Positions of these columns.
    pub fn columns(&self, wanted: &[String]) -> Result<Vec<usize>, FileError> {
        let at = |name: &String| self.names.iter().position(|n| n == name).ok_or_else(|| self.wrong(format!("no column `{name}`")));
        wanted.iter().map(at).collect()
    }

    pub fn wrong(&self, reason: String) -> FileError {
        FileError::new(&self.path, reason)
    }

    /// Hands every row to `take`.
    pub fn rows(&mut self, mut take: impl FnMut(&Row) -> Result<(), FileError>) -> Result<(), FileError> {
        for record in self.reader.records() {
            let record = record.map_err(|e| FileError::new(&self.path, e))?;
            let line = record.position().map_or(0, csv::Position::line);
            take(&Row { line, path: &self.path, names: &self.names, record: &record })?;
        }
        Ok(())
    }
}

pub(crate) struct Row<'a> {
    pub line: u64,
    path: &'a Path,
    names: &'a [String],
    record: &'a StringRecord,
}

impl Row<'_> {
    pub fn cell(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or_default().trim()
    }

    /// An error of this row; `reason` goes on behind the number of the line.
    pub fn wrong(&self, reason: &str) -> FileError {
        FileError::new(self.path, format!("line {}{reason}", self.line))
    }

    fn no(&self, column: usize, what: &str) -> FileError {
        self.wrong(&format!(", column `{}`: `{}` is not a {what}", self.names[column], self.cell(column)))
    }

    /// A whole number of at most `most`.
    pub fn whole(&self, column: usize, most: u64) -> Result<u64, FileError> {
        let number = self.cell(column).parse().ok().filter(|n| *n <= most);
        number.ok_or_else(|| self.no(column, &format!("whole number from 0 to {most}")))
    }

    /// Finite numbers.
    pub fn numbers(&self, columns: &[usize]) -> Result<Vec<f64>, FileError> {
        let number = |&c: &usize| self.cell(c).parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| self.no(c, "finite number"));
        columns.iter().map(number).collect()
    }

    /// Refuses a quaternion that is none of a rotation.
    pub fn unit(&self, columns: &[usize], quaternion: &[f64]) -> Result<(), FileError> {
        let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() <= UNIT {
            return Ok(());
        }
        let names: Vec<&str> = columns.iter().map(|&c| self.names[c].as_str()).collect();
        Err(self.wrong(&format!(", columns {}: a quaternion of length {length:.6}, 1 is needed", names.join(", "))))
    }
}

/// The first name that comes a second time.
pub(crate) fn twice<T: Copy + Eq + Hash>(names: impl IntoIterator<Item = T>) -> Option<T> {
    let mut seen = HashSet::new();
    names.into_iter().find(|name| !seen.insert(*name))
}
