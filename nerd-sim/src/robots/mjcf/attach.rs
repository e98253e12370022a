//! Attaches models of other files to bodies, with a prefix for all their names.

use std::sync::Arc;

use super::element::Element;
use super::placement::Placement;
use super::read::{Reader, root};
use super::scope::Scope;
use super::source::Source;
use crate::files::read_text;
use crate::internal::*;

/// Maximum nesting of attached models.
const MAX_DEPTH: usize = 8;

impl Reader {
    pub fn attach(&mut self, e: &Element, scope: &Scope) -> Result<(), UrdfError> {
        let Some(name) = e.word("model") else {
            return Err(e.refused("it names no model; a part of the file itself is not attached, write it out"));
        };
        if e.has("frame") {
            return Err(e.refused("a frame is not attached; name a body, or the model alone"));
        }
        let models = &scope.source.models;
        let asset = models.iter().find(|asset| asset.word("name") == Some(name) || asset.word("file") == Some(name));
        let asset = asset.ok_or_else(|| {
            e.refused(format!("there is no <model name=\"{}\"> among the assets", name.escape_debug()))
        })?;
        let file = asset.word("file").ok_or_else(|| asset.refused("it names no file"))?;
        let path = scope.source.folder.join(file);
        if self.depth == MAX_DEPTH {
            return Err(e.refused(format!("models attached more than {MAX_DEPTH} deep")));
        }
        let text = read_text(&path).map_err(|error| asset.refused(error))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let root = root(&text, Some(file), &folder)?;
        let source = Arc::new(Source::read(&root, &folder)?);
        let prefix = format!("{}{}", scope.at.prefix, e.text("prefix").unwrap_or_default());
        let at = Placement { prefix, ..scope.at.clone() };
        let own = Scope { source, class: None, at, ..scope.clone() };
        self.depth += 1;
        match e.word("body") {
            None => root.all("worldbody").try_for_each(|world| self.fill(world, &own))?,
            Some(body) => {
                let found = root.all("worldbody").find_map(|world| within(world, body));
                let found =
                    found.ok_or_else(|| e.refused(format!("model `{name}` has no body `{}`", body.escape_debug())))?;
                self.body(found, &own)?;
            }
        }
        self.attached(&root, &own)?;
        self.depth -= 1;
        Ok(())
    }

    /// Merges all sections of an attached model except bodies and options; elements that refer to missing bodies are
    /// left out.
    fn attached(&mut self, root: &Element, scope: &Scope) -> Result<(), UrdfError> {
        let keys = self.model.keys.len();
        self.sections(root, scope)?;
        // Keyframes of the attached model hold only that model's coordinates, so they are dropped.
        self.model.keys.truncate(keys);
        let bodies = &self.model.bodies;
        let model = &mut self.model.actuators;
        let there =
            |name: &String| bodies.iter().flat_map(|body| &body.joints).any(|joint| joint.name.as_ref() == Some(name));
        model.retain(|(actuator, _)| {
            actuator.joint.as_ref().is_none_or(|joint| !joint.starts_with(&scope.at.prefix) || there(joint))
        });
        Ok(())
    }
}

fn within<'a>(e: &'a Element, body: &str) -> Option<&'a Element> {
    e.children.iter().find_map(|child| {
        let own = child.tag == "body" && child.word("name") == Some(body);
        if own { Some(child) } else { within(child, body) }
    })
}
