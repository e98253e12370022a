//! Whether a file is whole: it ends where it should, and holds numbers where it should.

use std::io;
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors};

/// In the words of a number that is none.
pub const NOT_FINITE: &str = "not finite";

/// Says what is wrong with a file that the program wrote, by its kind.
pub fn whole(path: &Path) -> Result<(), String> {
    let wrong = |reason: String| format!("{}: {reason}", path.file_name().unwrap_or_default().to_string_lossy());
    let bytes = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
    let text = || std::str::from_utf8(&bytes).map_err(|e| wrong(e.to_string()));
    let json = |text: &str| serde_json::from_str::<serde_json::Value>(text).map(drop).map_err(|e| wrong(e.to_string()));
    match path.extension().and_then(|e| e.to_str()).unwrap_or_default() {
        "json" => json(text()?),
        // Of a log that grows line by line the last one may be cut.
        "jsonl" => text()?.split_inclusive('\n').filter(|line| line.ends_with('\n')).try_for_each(json),
        "csv" => table(&bytes).map_err(wrong),
        "safetensors" => tensors(&bytes).map_err(wrong),
        "svg" if !text()?.trim_end().ends_with("</svg>") => Err(wrong("no end".into())),
        "png" if !bytes.ends_with(b"IEND\xaeB`\x82") => Err(wrong("no end".into())),
        "tmp" => Err(wrong("left over".into())),
        _ => Ok(()),
    }
}

fn table(bytes: &[u8]) -> Result<(), String> {
    let mut reader = ::csv::Reader::from_reader(bytes);
    if bytes.last().is_some_and(|b| *b != b'\n') {
        return Err("no end".into());
    }
    for (i, record) in reader.records().enumerate() {
        let record = record.map_err(|e| e.to_string())?;
        if let Some(cell) = record.iter().find(|c| c.parse::<f64>().is_ok_and(|x| !x.is_finite())) {
            return Err(format!("line {} holds {cell}, which is {NOT_FINITE}", i + 2));
        }
    }
    Ok(())
}

/// Distances in empty space are infinite.
fn tensors(bytes: &[u8]) -> Result<(), String> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    for (name, view) in file.tensors() {
        let data = view.data();
        let finite = match view.dtype() {
            Dtype::F32 => data.chunks_exact(4).all(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]).is_finite()),
            Dtype::F64 => data.chunks_exact(8).all(|b| b.try_into().is_ok_and(|b| f64::from_le_bytes(b).is_finite())),
            _ => true,
        };
        if !finite && !name.contains("depths") {
            return Err(format!("`{name}` is {NOT_FINITE}"));
        }
    }
    Ok(())
}

/// Every file below a folder, in order; no link is followed. None below one that is not there.
pub fn below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    if !folder.exists() {
        return Ok(found);
    }
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        match entry.file_type()?.is_dir() {
            true => found.extend(below(&entry.path())?),
            false => found.push(entry.path()),
        }
    }
    found.sort();
    Ok(found)
}
