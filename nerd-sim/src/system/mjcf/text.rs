//! The text of an MJCF file as mjcf-rs shall see it: included files in their places (mjcf-rs puts their bodies into the world), compiler
//! settings first, and places and turns of default classes written out (mjcf-rs takes both from one class). What is refused has its line.

use std::collections::HashMap;

use roxmltree::{Document, Node};

use super::words::check;
use crate::files::read_text;
use crate::internal::*;

/// Elements may be nested this deep, and files included: mjcf-rs recurses.
const DEEPEST: usize = 128;
const INCLUDES: usize = 16;
/// Longest text, with what it includes (bytes).
const LARGEST: usize = 1 << 26;
/// How a place is turned.
const TURNS: [&str; 5] = ["quat", "axisangle", "xyaxes", "zaxis", "euler"];

#[derive(Default)]
pub(super) struct Source {
    pub text: String,
    /// Largest forces (N m or N) that actuators may have on a joint, by its name.
    pub efforts: HashMap<String, f64>,
    compilers: String,
    /// Where elements are, by kind and name.
    places: HashMap<(String, String), String>,
}

/// Whether a text is MJCF: its first element is.
pub fn is_mjcf(text: &str) -> bool {
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let end = match rest {
            _ if rest.starts_with("<!--") => "-->",
            _ if rest.starts_with("<?") || rest.starts_with("<!") => ">",
            _ => {
                return rest
                    .strip_prefix("<mujoco")
                    .is_some_and(|rest| rest.starts_with(['>', '/']) || rest.starts_with(char::is_whitespace));
            }
        };
        let Some(next) = rest.find(end) else { return false };
        rest = &rest[next..];
    }
    false
}

impl Source {
    /// From the text of a file in `folder`, where those that it includes are looked for.
    pub fn read(text: &str, folder: &Path) -> Result<Self, UrdfError> {
        let mut source = Self::default();
        let inside = source.expanded(text, folder, None, 0)?;
        source.text = format!("<mujoco>{}{inside}</mujoco>", source.compilers);
        source.inherit()?;
        Ok(source)
    }

    /// Why an element of this kind and name is refused, with its line.
    pub fn refused(&self, kind: &str, name: &str, reason: impl AsRef<str>) -> UrdfError {
        let place = self.places.get(&(kind.into(), name.into()));
        let place = place.map_or_else(String::new, |place| format!("{place}, "));
        UrdfError::Refused(format!("not an MJCF that can be read: {place}{kind} `{}`: {}", name.escape_debug(), reason.as_ref()))
    }

    /// What is inside of a file's root, checked, with the files that it includes; its compiler settings apart. `file` is its name if it is
    /// one of those.
    fn expanded(&mut self, text: &str, folder: &Path, file: Option<&str>, depth: usize) -> Result<String, UrdfError> {
        let wrong = |reason: &str| {
            let file = file.map_or_else(String::new, |file| format!("{file}: "));
            UrdfError::Refused(format!("not an MJCF that can be read: {file}{reason}"))
        };
        if nested(text) > DEEPEST {
            return Err(wrong(&format!("elements nested more than {DEEPEST} deep")));
        }
        let document = Document::parse(text.trim_start_matches('\u{feff}')).map_err(|e| wrong(&e.to_string()))?;
        let (text, root) = (document.input_text(), document.root_element());
        let (mut out, mut from) = (String::new(), root.first_child().map_or(0, |n| n.range().start));
        let end = root.last_child().map_or(from, |n| n.range().end);
        for node in root.descendants().filter(Node::is_element) {
            let (kind, line) = (node.tag_name().name(), document.text_pos_at(node.range().start).row);
            let place = file.map_or_else(|| format!("line {line}"), |file| format!("{file}, line {line}"));
            let named = node.ancestors().find_map(|n| Some(format!(", {} `{}`", n.tag_name().name(), n.attribute("name")?.escape_debug())));
            check(&node).map_err(|reason| {
                UrdfError::Refused(format!("not an MJCF that can be read: {place}{}: {reason}", named.unwrap_or_default()))
            })?;
            if let Some(name) = node.attribute("name") {
                self.places.entry((kind.into(), name.into())).or_insert(place);
            }
            let range = node.range();
            match kind {
                "include" => {
                    let name = node.attribute("file").unwrap_or_default();
                    let cannot = |reason: &str| wrong(&format!("line {line}: <include file=\"{name}\">: {reason}"));
                    if depth == INCLUDES {
                        return Err(cannot("files that include each other"));
                    }
                    let inner = read_text(&folder.join(name)).map_err(|e| cannot(&e.to_string()))?;
                    out += &text[from..range.start];
                    out += &self.expanded(&inner, folder, Some(name), depth + 1)?;
                    from = range.end;
                }
                "compiler" if node.parent() == Some(root) => {
                    out += &text[from..range.start];
                    self.compilers += &text[range.clone()];
                    from = range.end;
                }
                _ => {}
            }
            if out.len() > LARGEST {
                return Err(wrong("longer than 64 MB with what it includes"));
            }
        }
        out += &text[from..end];
        Ok(out)
    }

    /// Writes out what sites and geoms inherit of their places, and finds the efforts of joints.
    fn inherit(&mut self) -> Result<(), UrdfError> {
        let text = self.text.clone();
        let document = Document::parse(&text).map_err(|e| UrdfError::Refused(format!("not an MJCF that can be read: {e}")))?;
        let mut added = Vec::new();
        let bodies = document.descendants().filter(|n| n.is_element() && n.ancestors().any(|a| a.has_tag_name("worldbody")));
        for node in bodies.filter(|n| ["geom", "site", "joint"].contains(&n.tag_name().name())) {
            let (kind, name) = (node.tag_name().name(), node.attribute("name").unwrap_or_default());
            let classes = classes(&node).map_err(|class| self.refused(kind, name, format!("there is no default class `{class}`")))?;
            let inherited = |key: &str| {
                let own = |class: &Node| {
                    class.children().filter(|n| n.has_tag_name(kind)).filter_map(|n| n.attribute(key).map(String::from)).next_back()
                };
                classes.iter().find_map(own)
            };
            if kind == "joint" {
                let said = |key: &str| node.attribute(key).map(String::from).or_else(|| inherited(key));
                let range = said("actuatorfrcrange").filter(|_| said("actuatorfrclimited").as_deref() != Some("false"));
                let most = range.map(|r| r.split_whitespace().filter_map(|x| x.parse::<f64>().ok()).map(f64::abs).fold(0.0, f64::max));
                self.efforts.extend(most.map(|most| (name.to_string(), most)));
                continue;
            }
            for keys in [&["pos"][..], &TURNS] {
                if keys.iter().all(|key| !node.has_attribute(*key))
                    && let Some((key, value)) = keys.iter().find_map(|key| Some((key, inherited(key)?)))
                {
                    added.push((node.range().start + 1 + kind.len(), format!(" {key}=\"{value}\"")));
                }
            }
        }
        added.into_iter().rev().for_each(|(at, what)| self.text.insert_str(at, &what));
        Ok(())
    }
}

/// The default classes of an element, its own first; the name of one that is not there.
fn classes<'a>(node: &Node<'a, 'a>) -> Result<Vec<Node<'a, 'a>>, String> {
    let class = node.attribute("class").or_else(|| node.ancestors().skip(1).find_map(|n| n.attribute("childclass")));
    let tops = || node.document().root_element().children().filter(|n| n.has_tag_name("default"));
    let main = |n: &Node| n.attribute("class").is_none_or(|class| class == "main");
    let all = || tops().flat_map(|n| n.descendants()).filter(|n| n.has_tag_name("default"));
    let own = class.filter(|class| *class != "main").map(|class| all().find(|n| n.attribute("class") == Some(class)).ok_or(class));
    let own = own.transpose()?;
    let above = own.into_iter().flat_map(|n| n.ancestors()).filter(|n| n.has_tag_name("default"));
    Ok(above.chain(tops().filter(main)).collect())
}

/// How deep elements are nested, at most, without a parser that might recurse over them.
fn nested(text: &str) -> usize {
    let (mut deep, mut most) = (0usize, 0);
    for (at, _) in text.match_indices('<') {
        let rest = &text[at + 1..];
        match rest.as_bytes().first() {
            Some(b'/') => deep = deep.saturating_sub(1),
            Some(b'!' | b'?') | None => {}
            Some(_) if rest.find('>').is_some_and(|end| rest[..end].ends_with('/')) => most = most.max(deep + 1),
            Some(_) => deep += 1,
        }
        most = most.max(deep);
    }
    most
}

pub(crate) fn numbers(x: &[f64]) -> String {
    x.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
