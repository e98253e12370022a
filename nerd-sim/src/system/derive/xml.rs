//! Parses XML files that accompany a robot's file.

use roxmltree::Document;

use crate::files::nested;

/// Maximum nesting of elements: roxmltree recurses.
const DEEPEST: usize = 256;

/// Parses `text` as XML.
pub(super) fn document(text: &str) -> Result<Document<'_>, String> {
    if nested(text) > DEEPEST {
        return Err(format!("elements nested more than {DEEPEST} deep"));
    }
    Document::parse(text).map_err(|e| e.to_string())
}
