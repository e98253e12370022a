//! Context for reading elements.

use std::sync::Arc;

use super::element::Element;
use super::placement::Placement;
use super::source::Source;
use crate::internal::*;

/// Where an element stands: its file, body, frame on the body, default class, and prefix and suffix of names.
#[derive(Clone)]
pub(super) struct Scope {
    pub source: Arc<Source>,
    pub body: usize,
    pub class: Option<String>,
    pub at: Placement,
}

impl Scope {
    /// Path of an asset's file, and name of the asset: its attribute `name`, else the file's stem.
    pub fn asset(&self, e: &Element) -> Result<(Option<PathBuf>, String), UrdfError> {
        let file = self.source.asset(e);
        let stem = file.as_ref().and_then(|file| file.file_stem()).map(|stem| stem.to_string_lossy().into_owned());
        let name =
            e.word("name").map(String::from).or(stem).ok_or_else(|| e.refused("it has neither name nor file"))?;
        Ok((file, format!("{}{name}", self.at.prefix)))
    }

    /// The scope inside an element with this pose.
    pub fn within(&self, e: &Element, pose: &Isometry3<f64>) -> Self {
        let class = e.word("childclass").map(String::from).or_else(|| self.class.clone());
        Self { class, at: Placement { frame: self.at.frame * pose, ..self.at.clone() }, ..self.clone() }
    }
}
