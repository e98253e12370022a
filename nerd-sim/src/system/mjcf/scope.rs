//! The context in which elements are read.

use std::sync::Arc;

use super::element::Element;
use super::placement::Placement;
use super::source::Source;
use crate::internal::*;

/// The body, the frame on it, the default class and the affixes of names.
#[derive(Clone)]
pub(super) struct Scope {
    pub source: Arc<Source>,
    pub body: usize,
    pub class: Option<String>,
    pub at: Placement,
}

impl Scope {
    /// The same inside an element with this pose.
    pub fn within(&self, e: &Element, pose: &Isometry3<f64>) -> Self {
        let class = e.word("childclass").map(String::from).or_else(|| self.class.clone());
        Self { class, at: Placement { frame: self.at.frame * pose, ..self.at.clone() }, ..self.clone() }
    }
}
