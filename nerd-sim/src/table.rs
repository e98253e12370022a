//! Reads tables with columns in any order, found by name: CSV files or arrays. Errors name file, row and column.

use std::io::{BufRead, BufReader, Read};
use std::{collections::HashSet, fmt, fs::File, hash::Hash};

use csv::StringRecord;

use crate::{arrays::Arrays, files::LARGEST_TABLE, internal::*};

/// Tolerance of a quaternion's length against 1: files round digits.
const LENGTH_TOLERANCE: f64 = 1e-3;
/// Largest length (bytes) of the first line in the search for a delimiter.
const MAX_FIRST_LINE: u64 = 1 << 20;

pub(crate) struct Table {
    path: PathBuf,
    pub names: Vec<String>,
    source: Source,
}

enum Source {
    Csv(csv::Reader<File>),
    Arrays(Arrays),
}

impl Table {
    /// Opens a CSV or, decided by the file extension, a file of arrays with the columns `wanted`.
    pub fn of(path: &Path, wanted: &[&String]) -> Result<Self, FileError> {
        if !Arrays::named(path) {
            return Self::open(path);
        }
        let names = wanted.iter().copied().cloned().collect();
        let source = Source::Arrays(Arrays::read(path, wanted)?);
        Ok(Self { path: path.into(), names, source })
    }

    /// Opens a CSV. The first line of the file determines the delimiter: commas, else semicolons or tabs.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let cannot = |e: &dyn fmt::Display| FileError::new(path, format!("cannot read it: {e}"));
        crate::files::bounded(path, LARGEST_TABLE).map_err(|e| cannot(&e))?;
        let mut first = Vec::new();
        BufReader::new(File::open(path).map_err(|e| cannot(&e))?)
            .take(MAX_FIRST_LINE)
            .read_until(b'\n', &mut first)
            .map_err(|e| cannot(&e))?;
        let between = [b',', b';', b'\t'].into_iter().find(|byte| first.contains(byte)).unwrap_or(b',');
        let mut reader = csv::ReaderBuilder::new().delimiter(between).from_path(path).map_err(|e| cannot(&e))?;
        let header = reader.headers().map_err(|e| FileError::new(path, e))?;
        let names = header.iter().map(|name| name.trim().to_string()).collect();
        Ok(Self { path: path.into(), names, source: Source::Csv(reader) })
    }

    /// Indices of the columns `wanted`.
    pub fn columns(&self, wanted: &[String]) -> Result<Vec<usize>, FileError> {
        let at = |name: &String| {
            self.names.iter().position(|n| n == name).ok_or_else(|| self.wrong(format!("no column `{name}`")))
        };
        wanted.iter().map(at).collect()
    }

    pub fn wrong(&self, reason: String) -> FileError {
        FileError::new(&self.path, reason)
    }

    /// Passes every row to `take`.
    pub fn rows(&mut self, mut take: impl FnMut(&Row) -> Result<(), FileError>) -> Result<(), FileError> {
        let path = &self.path;
        let names = &self.names;
        match &mut self.source {
            Source::Csv(reader) => reader.records().try_for_each(|record| {
                let record = record.map_err(|e| FileError::new(path, e))?;
                let place = Place { line: record.position().map_or(0, csv::Position::line), of: None };
                take(&Row { place, path, names, cells: Cells::Text(&record) })
            }),
            Source::Arrays(arrays) => (0..arrays.rows()).try_for_each(|row| {
                let (trajectory, line) = arrays.place(row);
                take(&Row {
                    place: Place { line, of: Some(trajectory) },
                    path,
                    names,
                    cells: Cells::Numbers(arrays, row),
                })
            }),
        }
    }
}

/// Position of a row in its file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// Line of a text file, from 1; row of an array, from 0.
    line: u64,
    /// `None` for text files; for arrays, the trajectory, if the arrays have a trajectory axis.
    of: Option<Option<u64>>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.of {
            None => write!(f, "line {}", self.line),
            Some(None) => write!(f, "row {}", self.line),
            Some(Some(trajectory)) => write!(f, "trajectory {trajectory}, row {}", self.line),
        }
    }
}

pub(crate) struct Row<'a> {
    pub place: Place,
    path: &'a Path,
    names: &'a [String],
    cells: Cells<'a>,
}

enum Cells<'a> {
    Text(&'a StringRecord),
    Numbers(&'a Arrays, usize),
}

impl Row<'_> {
    fn cell(&self, column: usize) -> String {
        match &self.cells {
            Cells::Text(record) => record.get(column).unwrap_or_default().trim().into(),
            Cells::Numbers(arrays, row) => arrays.number(column, *row).to_string(),
        }
    }

    fn number(&self, column: usize) -> Option<f64> {
        match &self.cells {
            Cells::Text(record) => record.get(column).unwrap_or_default().trim().parse().ok(),
            Cells::Numbers(arrays, row) => Some(arrays.number(column, *row)),
        }
    }

    /// Whether a cell of a CSV is empty, or NaN in arrays.
    pub fn empty(&self, column: usize) -> bool {
        match &self.cells {
            Cells::Text(record) => record.get(column).is_none_or(|cell| cell.trim().is_empty()),
            Cells::Numbers(arrays, row) => arrays.number(column, *row).is_nan(),
        }
    }

    /// Trajectory of this row, if the file holds arrays with a trajectory axis.
    pub fn trajectory(&self) -> Option<u64> {
        self.place.of.flatten()
    }

    /// An error at this row; `reason` follows the position.
    pub fn wrong(&self, reason: &str) -> FileError {
        FileError::new(self.path, format!("{}{reason}", self.place))
    }

    fn no(&self, column: usize, what: &str) -> FileError {
        self.wrong(&format!(", column `{}`: `{}` is not a {what}", self.names[column], self.cell(column)))
    }

    /// A whole number from 0 to `most`.
    pub fn whole(&self, column: usize, most: u64) -> Result<u64, FileError> {
        let number = self.cell(column).parse().ok().filter(|n| *n <= most);
        number.ok_or_else(|| self.no(column, &format!("whole number from 0 to {most}")))
    }

    /// The numbers in `columns`; refuses NaN and infinities.
    pub fn numbers(&self, columns: &[usize]) -> Result<Vec<f64>, FileError> {
        let number = |&c: &usize| self.number(c).filter(|x| x.is_finite()).ok_or_else(|| self.no(c, "finite number"));
        columns.iter().map(number).collect()
    }

    /// Refuses a quaternion without unit length.
    pub fn unit(&self, columns: &[usize], quaternion: &[f64]) -> Result<(), FileError> {
        let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() <= LENGTH_TOLERANCE {
            return Ok(());
        }
        let names: Vec<&str> = columns.iter().map(|&c| self.names[c].as_str()).collect();
        Err(self.wrong(&format!(", columns {}: a quaternion of length {length:.6}, 1 is needed", names.join(", "))))
    }
}

/// The first name that is repeated.
pub(crate) fn twice<T: Copy + Eq + Hash>(names: impl IntoIterator<Item = T>) -> Option<T> {
    let mut seen = HashSet::new();
    names.into_iter().find(|name| !seen.insert(*name))
}
