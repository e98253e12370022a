//! Reads named arrays from numpy's .npz files and .safetensors files as columns of a table.
//!
//! Column `q` is an array with one number per row. `q.2` is component 2 of an array with several components on its last
//! axis. The other axes are rows, or trajectories and their rows.

use std::{borrow::Cow, fs::File, io::Read};

use safetensors::tensor::SafeTensors;

use crate::files::{LARGEST_TABLE, too_large};
use crate::internal::*;

pub(crate) struct Arrays {
    arrays: BTreeMap<String, Array>,
    /// For each column: array name, numbers per row, index of the component.
    columns: Vec<(String, usize, usize)>,
    /// Number of trajectories, if the arrays have a trajectory axis, and number of rows of each trajectory.
    shape: (Option<usize>, usize),
}

struct Array {
    shape: Vec<usize>,
    /// Bytes per number, and the function that decodes a number from its bytes.
    kind: (usize, fn(&[u8]) -> f64),
    bytes: Vec<u8>,
}

impl Arrays {
    /// Whether the file extension is .npz or .safetensors.
    pub fn named(path: &Path) -> bool {
        path.extension().is_some_and(|e| e == "npz" || e == "safetensors")
    }

    pub fn read(path: &Path, wanted: &[&String]) -> Result<Self, FileError> {
        let wrong = |reason: String| FileError::new(path, reason);
        let used = |name: &str| wanted.iter().any(|w| *w == name || split(w).is_some_and(|(array, _)| array == name));
        let all = if path.extension().is_some_and(|e| e == "npz") {
            npz(path, LARGEST_TABLE, &used)
        } else {
            tensors(path, &used)
        };
        let (arrays, names) = all.map_err(wrong)?;
        let mut columns = Vec::new();
        let mut shape = None;
        for name in wanted {
            let part = |(array, at)| Some((array, arrays.get(array)?, Some(at)));
            let whole = arrays.get(*name).map(|array| (name.as_str(), array, None));
            let Some((array, found, at)) = whole.or_else(|| split(name).and_then(part)) else {
                return Err(wrong(format!("no array has column `{name}`; there are {}", names.join(", "))));
            };
            let (rows, width) = match (at, &found.shape[..]) {
                (Some(at), [rows @ .., width]) if at < *width => (rows, *width),
                (None, rows) => (rows, 1),
                _ => {
                    return Err(wrong(format!(
                        "no array has column `{name}`: `{array}` is of shape {:?}",
                        found.shape
                    )));
                }
            };
            let own = match *rows {
                [rows] => (None, rows),
                [trajectories, rows] => (Some(trajectories), rows),
                _ => {
                    let text =
                        "rows, or trajectories and rows, and then perhaps components, of which `NAME.0` is the first";
                    return Err(wrong(format!(
                        "column `{name}`: `{array}` is of shape {:?}; its axes must be {text}",
                        found.shape
                    )));
                }
            };
            let (first, other) = shape.get_or_insert((name.as_str(), own));
            if *other != own {
                return Err(wrong(format!(
                    "columns `{first}` and `{name}` have not the same rows: {} and {}",
                    said(*other),
                    said(own)
                )));
            }
            columns.push((array.to_string(), width, at.unwrap_or(0)));
        }
        Ok(Self { arrays, columns, shape: shape.map_or((None, 0), |s| s.1) })
    }

    pub fn rows(&self) -> usize {
        self.shape.0.unwrap_or(1) * self.shape.1
    }

    /// Splits a row index over all trajectories into trajectory and row within the trajectory.
    pub fn place(&self, row: usize) -> (Option<u64>, u64) {
        let rows = self.shape.1.max(1);
        (self.shape.0.map(|_| (row / rows) as u64), (row % rows) as u64)
    }

    /// The number at `column` and `row`.
    pub fn number(&self, column: usize, row: usize) -> f64 {
        let (array, width, at) = &self.columns[column];
        let Array { kind: (size, number), bytes, .. } = &self.arrays[array];
        number(&bytes[(row * width + at) * size..])
    }
}

fn split(column: &str) -> Option<(&str, usize)> {
    let (array, at) = column.rsplit_once('.')?;
    Some((array, at.parse().ok()?))
}

fn said((trajectories, rows): (Option<usize>, usize)) -> String {
    trajectories.map_or_else(|| rows.to_string(), |n| format!("{n} x {rows}"))
}

impl Array {
    /// An array from its raw bytes; `kind` is the type's name in numpy or safetensors.
    fn new(name: &str, kind: &str, shape: Vec<usize>, bytes: Cow<'_, [u8]>) -> Result<Self, String> {
        let kind: (usize, fn(&[u8]) -> f64) = match kind {
            "<f4" | "F32" => (4, |b| b.first_chunk().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(*b)))),
            "<f8" | "F64" => (8, |b| b.first_chunk().map_or(f64::NAN, |b| f64::from_le_bytes(*b))),
            "<i4" | "I32" => (4, |b| b.first_chunk().map_or(f64::NAN, |b| f64::from(i32::from_le_bytes(*b)))),
            "<i8" | "I64" => (8, |b| b.first_chunk().map_or(f64::NAN, |b| i64::from_le_bytes(*b) as f64)),
            _ => return Err(format!("array `{name}` is of type {kind}; float32, float64, int32 and int64 are read")),
        };
        match shape.iter().try_fold(kind.0, |n, k| n.checked_mul(*k)) {
            Some(size) if size == bytes.len() => Ok(Self { shape, kind, bytes: bytes.into_owned() }),
            _ => Err(format!("array `{name}` of shape {shape:?} has {} bytes: the file is damaged", bytes.len())),
        }
    }
}

/// The requested arrays, and the names of all arrays.
type Found = (BTreeMap<String, Array>, Vec<String>);

fn tensors(path: &Path, used: &dyn Fn(&str) -> bool) -> Result<Found, String> {
    let bytes = crate::files::read_most(path, LARGEST_TABLE).map_err(|e| e.to_string())?;
    let file = SafeTensors::deserialize(&bytes).map_err(|e| e.to_string())?;
    let mut names: Vec<String> = file.names().into_iter().map(String::from).collect();
    names.sort();
    let read = |name: &String| {
        let view = file.tensor(name).map_err(|e| e.to_string())?;
        let array = Array::new(name, &format!("{:?}", view.dtype()), view.shape().to_vec(), view.data().into())?;
        Ok((name.clone(), array))
    };
    let arrays = names.iter().filter(|name| used(name)).map(read).collect::<Result<_, String>>()?;
    Ok((arrays, names))
}

fn npz(path: &Path, most: u64, used: &dyn Fn(&str) -> bool) -> Result<Found, String> {
    crate::files::is_file(path).map_err(|e| e.to_string())?;
    let file = File::open(path).map_err(|e| e.to_string())?;
    let mut zip = zip::ZipArchive::new(std::io::BufReader::new(file)).map_err(|e| e.to_string())?;
    let mut arrays = BTreeMap::new();
    let mut names = Vec::new();
    let mut left = most;
    for k in 0..zip.len() {
        let mut entry = zip.by_index(k).map_err(|e| e.to_string())?;
        let Some(name) = entry.name().strip_suffix(".npy").map(String::from) else { continue };
        if used(&name) {
            let size = entry.size();
            let mut bytes = Vec::new();
            if size > left {
                return Err(format!("array `{name}` {}", too_large(size, left)));
            }
            left -= size;
            // An entry that unpacks to more than its stated size is cut here and refused below by its length.
            entry.by_ref().take(size).read_to_end(&mut bytes).map_err(|e| format!("array `{name}`: {e}"))?;
            arrays.insert(name.clone(), npy(&name, &bytes)?);
        }
        names.push(name);
    }
    Ok((arrays, names))
}

/// Parses the format of `numpy.save`: magic and version, header length, header (a Python dictionary), numbers.
fn npy(name: &str, bytes: &[u8]) -> Result<Array, String> {
    let from = if bytes.get(6) == Some(&1) { 10 } else { 12 };
    let length = bytes.get(8..from).map(|b| b.iter().rev().fold(0usize, |n, b| n << 8 | usize::from(*b)));
    let end =
        length.and_then(|n| n.checked_add(from)).filter(|end| *end <= bytes.len() && bytes.starts_with(b"\x93NUMPY"));
    let Some(end) = end else { return Err(format!("array `{name}` is not as numpy.save writes one")) };
    let header = String::from_utf8_lossy(&bytes[from..end]);
    let value = |key: &str, end: char| Some(header.split_once(&format!("'{key}':"))?.1.split(end).next()?.trim());
    let shape = value("shape", ')').and_then(|s| {
        let axes = s.trim_start_matches('(').split(',').map(str::trim).filter(|axis| !axis.is_empty());
        axes.map(|axis| axis.parse().ok()).collect::<Option<Vec<usize>>>()
    });
    let (Some(kind), Some(shape)) = (value("descr", ','), shape) else {
        return Err(format!("array `{name}` has no shape or type"));
    };
    if shape.len() > 1 && value("fortran_order", ',') != Some("False") {
        return Err(format!("array `{name}` has its columns in a row each; save numpy.ascontiguousarray({name})"));
    }
    Array::new(name, kind.trim_matches('\''), shape, bytes[end..].into())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn an_array_that_unpacks_to_more_than_is_borne_is_refused_with_its_size() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let mut zip = zip::ZipWriter::new(file.reopen().expect("opened"));
        zip.start_file("q.npy", zip::write::FileOptions::default()).expect("begun");
        (0..64).for_each(|_| zip.write_all(&[0; 1 << 20]).expect("written"));
        zip.finish().expect("done");
        let packed = file.path().metadata().expect("there").len();
        let said = npz(file.path(), 1 << 25, &|_| true).err().unwrap_or_default();
        assert_eq!(said, "array `q` has 64 MB; at most 32 MB are read", "{packed} bytes");
        // Arrays that are not requested are not unpacked.
        assert!(npz(file.path(), 1 << 25, &|_| false).is_ok());
    }
}
