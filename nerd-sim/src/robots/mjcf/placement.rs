//! Frame of an element on its body, and prefix and suffix of its name.

use crate::internal::*;

#[derive(Clone, Debug)]
pub(super) struct Placement {
    /// Frame of the element in the body's frame.
    pub frame: Isometry3<f64>,
    /// Prefix of names, from attached models; `suffix`: suffix of names, from replicas.
    pub prefix: String,
    pub suffix: String,
}

impl Placement {
    /// Name in the model of an element named `own` in its file: `own` with prefix and suffix.
    pub fn name(&self, own: &str) -> String {
        format!("{}{own}{}", self.prefix, self.suffix)
    }
}
