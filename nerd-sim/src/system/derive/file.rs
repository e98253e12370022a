//! Files of meshes: how much of one is borne, and its bytes.

use std::path::Path;

/// Largest file that is read (bytes).
const LARGEST: u64 = 1 << 28;
/// Nodes of a file may be nested this deep.
pub(super) const DEEPEST: usize = 64;
/// Most elements of its nodes, and most vertices, what is shown twice counted twice: a short file may ask for 2^64 of them.
pub(super) const NODES: usize = 1_000_000;
pub(super) const MOST: usize = 10_000_000;

/// What a file of a bearable size holds.
pub(super) fn bytes_of(path: &Path) -> Result<Vec<u8>, String> {
    let about = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if !about.is_file() || about.len() > LARGEST {
        return Err(format!("is no file, or has more than {LARGEST} bytes"));
    }
    let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
    if bytes.starts_with(b"version https://git-lfs") {
        return Err("is a pointer of Git LFS in the file's place; run `git lfs pull` where it comes from".into());
    }
    Ok(bytes)
}
