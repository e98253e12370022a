//! Frame of an element on its body, and the affixes of its name.

use crate::internal::*;

#[derive(Clone, Debug)]
pub(super) struct Placement {
    /// Frame of the element in the body's frame.
    pub frame: Isometry3<f64>,
    /// Prefix and suffix of names.
    pub prefix: String,
    pub suffix: String,
}

impl Placement {
    /// `own` with prefix and suffix: its name in the model.
    pub fn name(&self, own: &str) -> String {
        format!("{}{own}{}", self.prefix, self.suffix)
    }
}
