//! XML of files beside a robot's own.

use roxmltree::Document;

use crate::files::nested;

/// Elements may be nested this deep: roxmltree recurses.
const DEEPEST: usize = 256;

/// A text's elements.
pub(super) fn document(text: &str) -> Result<Document<'_>, String> {
    if nested(text) > DEEPEST {
        return Err(format!("elements nested more than {DEEPEST} deep"));
    }
    Document::parse(text).map_err(|e| e.to_string())
}
