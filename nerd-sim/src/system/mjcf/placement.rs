//! Frame of an element on its body, and the affixes of its name.

use crate::internal::*;

#[derive(Clone, Debug)]
pub(super) struct Placement {
    /// The element's frame, in the body's frame.
    pub frame: Isometry3<f64>,
    /// Prefix and suffix of its name.
    pub prefix: String,
    pub suffix: String,
}

impl Placement {
    /// A name in the model.
    pub fn name(&self, own: &str) -> String {
        format!("{}{own}{}", self.prefix, self.suffix)
    }
}
