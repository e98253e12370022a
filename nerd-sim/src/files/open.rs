//! Open files and their names.

use std::fs::File;
use std::path::Path;

/// Whether an open file is still the one of that name.
pub(super) fn is_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let of = |m: &std::fs::Metadata| (m.dev(), m.ino());
        matches!((file.metadata(), std::fs::metadata(path)), (Ok(a), Ok(b)) if of(&a) == of(&b))
    }
    #[cfg(not(unix))]
    {
        file.metadata().is_ok() && path.exists()
    }
}
