//! CSV files whose columns are found by name, in any order. Errors name file, line and column.

use std::fs::File;
use std::path::{Path, PathBuf};

use csv::StringRecord;

/// How far a quaternion's length may be from 1: digits are cut in files.
const UNIT: f64 = 1e-3;

/// Why a table cannot be read; one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// There is no such file, or none that may be read.
    #[error("{}: cannot read it: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: csv::Error,
    },
    /// It is no CSV.
    #[error("{}: {source}", path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// Where it ends to be one.
        source: csv::Error,
    },
    /// It does not hold what is needed.
    #[error("{}: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is missing, or wrong, with its line if it has one.
        reason: String,
    },
}

/// An open table.
pub(crate) struct Table {
    path: PathBuf,
    names: Vec<String>,
    reader: csv::Reader<File>,
}

impl Table {
    pub fn open(path: &Path) -> Result<Self, TableError> {
        let mut reader = csv::Reader::from_path(path).map_err(|source| TableError::File { path: path.into(), source })?;
        let header = reader.headers().map_err(|source| TableError::Csv { path: path.into(), source })?;
        Ok(Self { path: path.into(), names: header.iter().map(|name| name.trim().to_string()).collect(), reader })
    }

    /// The columns' names.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Positions of these columns.
    pub fn columns(&self, wanted: &[&str]) -> Result<Vec<usize>, TableError> {
        let at = |name: &&str| self.names.iter().position(|n| n == name).ok_or_else(|| self.wrong(format!("no column `{name}`")));
        wanted.iter().map(at).collect()
    }

    pub fn wrong(&self, reason: String) -> TableError {
        TableError::Content { path: self.path.clone(), reason }
    }

    /// Hands every row to `take`.
    pub fn rows(&mut self, mut take: impl FnMut(&Row) -> Result<(), TableError>) -> Result<(), TableError> {
        for record in self.reader.records() {
            let record = record.map_err(|source| TableError::Csv { path: self.path.clone(), source })?;
            let line = record.position().map_or(0, csv::Position::line);
            take(&Row { line, path: &self.path, names: &self.names, record: &record })?;
        }
        Ok(())
    }
}

/// A row that knows its line.
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
    pub fn wrong(&self, reason: &str) -> TableError {
        TableError::Content { path: self.path.into(), reason: format!("line {}{reason}", self.line) }
    }

    fn no(&self, column: usize, what: &str) -> TableError {
        self.wrong(&format!(", column `{}`: `{}` is not a {what}", self.names[column], self.cell(column)))
    }

    /// A whole number of at most `most`.
    pub fn whole(&self, column: usize, most: u64) -> Result<u64, TableError> {
        let number = self.cell(column).parse().ok().filter(|n| *n <= most);
        number.ok_or_else(|| self.no(column, &format!("whole number from 0 to {most}")))
    }

    /// Finite numbers.
    pub fn numbers(&self, columns: &[usize]) -> Result<Vec<f64>, TableError> {
        let number = |&c: &usize| self.cell(c).parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| self.no(c, "finite number"));
        columns.iter().map(number).collect()
    }

    /// Refuses a quaternion that is none of a rotation.
    pub fn unit(&self, columns: &[usize], quaternion: &[f64]) -> Result<(), TableError> {
        let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() <= UNIT {
            return Ok(());
        }
        let names: Vec<&str> = columns.iter().map(|&c| self.names[c].as_str()).collect();
        Err(self.wrong(&format!(", columns {}: a quaternion of length {length:.6}, 1 is needed", names.join(", "))))
    }
}
