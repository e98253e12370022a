//! Parses XML files that accompany a robot's file.

use roxmltree::Document;

use crate::files::nested;

/// Maximum nesting of elements: roxmltree recurses.
const MAX_DEPTH: usize = 256;

/// Parses `text` as XML.
pub(super) fn document(text: &str) -> Result<Document<'_>, String> {
    if nested(text) > MAX_DEPTH {
        return Err(format!("elements nested more than {MAX_DEPTH} deep"));
    }
    Document::parse(text).map_err(|e| e.to_string())
}
