//! Size limits of mesh files, and reading their bytes.

use std::path::Path;

/// Largest file size (bytes).
pub(crate) const MAX_FILE_SIZE: u64 = 1 << 28;
/// Maximum nesting of nodes.
pub(crate) const MAX_DEPTH: usize = 64;
/// Maximum number of node elements and of vertices, counted once per instance: a short file may state 2^64 of them.
pub(crate) const MAX_NODES: usize = 1_000_000;
pub(crate) const MAX_VERTICES: usize = 10_000_000;

/// The bytes of a file within the size limit.
pub(crate) fn bytes_of(path: &Path) -> Result<Vec<u8>, String> {
    let about = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if !about.is_file() || about.len() > MAX_FILE_SIZE {
        return Err(format!("is no file, or has more than {MAX_FILE_SIZE} bytes"));
    }
    let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
    if bytes.starts_with(b"version https://git-lfs") {
        return Err("is a pointer of Git LFS in the file's place; run `git lfs pull` where it comes from".into());
    }
    Ok(bytes)
}
