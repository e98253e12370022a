//! A robot's file, URDF or MJCF, as a URDF and keys of a specification.

use mjcf_rs::Model;
use toml::Table;

use super::text::{Source, is_mjcf};
use super::{description::Description, keys::described, tree::Tree};
use crate::internal::*;

impl<'a> Description<'a> {
    /// Of a robot's text, URDF or MJCF; `path` is the file's.
    pub fn of(text: &'a str, path: Option<&Path>) -> Result<Self, UrdfError> {
        let plain =
            Self { urdf: text.into(), keys: Table::new(), notes: Vec::new(), quaternion: [0.0, 0.0, 0.0, 1.0], floor: 0.0, friction: None };
        if !is_mjcf(text) {
            return Ok(plain);
        }
        let source = Source::read(text, path.and_then(Path::parent).unwrap_or(Path::new(".")))?;
        // User input never panics here, whatever mjcf-rs does.
        let model = std::panic::catch_unwind(|| Model::from_str(&source.text, "."));
        let model = model.map_err(|_| "malformed text".to_string()).and_then(|read| read.map_err(|e| e.to_string()));
        let model = model.map_err(|e| {
            UrdfError::Refused(format!("not an MJCF that can be read: {}", e.split_whitespace().collect::<Vec<_>>().join(" ")))
        })?;
        described(Tree::new(&model, &source)?.write()?)
    }
}
