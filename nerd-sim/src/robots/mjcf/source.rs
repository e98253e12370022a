//! Settings of a file: compiler, default classes and models to attach.

use std::collections::HashMap;

use super::classes::Classes;
use super::compiler::Compiler;
use super::element::Element;
use crate::internal::*;

/// A file with its compiler settings and default classes.
pub(super) struct Source {
    pub compiler: Compiler,
    pub classes: Classes,
    /// Folder of the main file.
    pub folder: PathBuf,
    /// Number of user values allowed per kind of object, where the file sets it.
    pub users: HashMap<String, usize>,
    /// Models that may be attached.
    pub models: Vec<Element>,
}

impl Source {
    pub fn read(root: &Element, folder: &Path) -> Result<Self, UrdfError> {
        let compiler = Compiler::read(root)?;
        let classes = Classes::read(root, &compiler)?;
        let models = root.all("asset").flat_map(|asset| asset.all("model")).cloned().collect();
        let sizes = root.all("size").flat_map(|size| &size.attributes);
        let users = sizes.filter_map(|(key, text)| {
            let kind = key.strip_prefix("nuser_")?;
            let kind = [("jnt", "joint"), ("cam", "camera")]
                .iter()
                .find(|(short, _)| *short == kind)
                .map_or(kind, |(_, kind)| kind);
            Some((kind.to_string(), text.trim().parse().ok()?))
        });
        Ok(Self { users: users.collect(), compiler, classes, folder: folder.into(), models })
    }

    /// Path of an asset's file: in the folder of meshes, else relative to the included file that names the asset.
    pub fn asset(&self, e: &Element) -> Option<PathBuf> {
        let file = e.word("file")?.replace('\\', "/");
        let file = if self.compiler.strip { file.rsplit('/').next().unwrap_or_default().to_string() } else { file };
        let first = self.folder.join(&self.compiler.meshes).join(&file);
        let beside = e.place.folder.join(&file);
        Some(if !first.is_file() && e.place.file.is_some() && beside.is_file() { beside } else { first })
    }
}
