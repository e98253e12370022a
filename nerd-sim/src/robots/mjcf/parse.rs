//! Parses the text of an MJCF into elements, with included files in place.

use std::collections::HashSet;
use std::sync::Arc;

use roxmltree::{Document, Node, TextPos};

use super::element::{Element, Place};
use crate::files::nested;
use crate::files::read_text;
use crate::internal::*;

/// Maximum nesting of elements; [`MAX_INCLUDE_DEPTH`]: of included files.
const MAX_DEPTH: usize = 128;
const MAX_INCLUDE_DEPTH: usize = 16;
/// Maximum length (bytes) of a file's text and the texts that it includes, together.
const MAX_TEXT: usize = 1 << 26;

/// Whether a text is MJCF, with `<mujoco>` as first element.
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

/// The text before a stray end tag at position `at`, if there is one. MuJoCo stops reading at an end tag after the root
/// element, so files with a doubled end tag are valid there.
fn until_stray_end(text: &str, at: TextPos) -> Option<&str> {
    let line: usize = text.split_inclusive('\n').take(at.row.saturating_sub(1) as usize).map(str::len).sum();
    let column = text[line..].char_indices().nth(at.col.saturating_sub(1) as usize)?.0;
    text[line + column..].starts_with("</").then(|| &text[..line + column])
}

/// Parses files into elements.
pub(super) struct Parser<'a> {
    /// Folder of the main file; included files are searched there first.
    pub folder: &'a Path,
    /// Total length (bytes) of all texts parsed so far.
    pub length: usize,
    /// Files included so far.
    pub seen: HashSet<PathBuf>,
}

impl Parser<'_> {
    /// Root element of a text. `file`: name of the file if it is included; `depth`: nesting of includes.
    pub fn parse(&mut self, text: &str, file: Option<&str>, folder: &Path, depth: usize) -> Result<Element, UrdfError> {
        let wrong = |reason: String| {
            let file = file.map_or_else(String::new, |file| format!("{file}: "));
            UrdfError::Refused(format!("not an MJCF that can be read: {file}{reason}"))
        };
        self.length += text.len();
        if self.length > MAX_TEXT {
            return Err(wrong("longer than 64 MB with what it includes".into()));
        }
        if nested(text) > MAX_DEPTH {
            return Err(wrong(format!("elements nested more than {MAX_DEPTH} deep")));
        }
        let text = text.trim_start_matches('\u{feff}');
        let parsed = Document::parse(text)
            .or_else(|e| until_stray_end(text, e.pos()).and_then(|text| Document::parse(text).ok()).ok_or(e));
        let document = parsed.map_err(|e| wrong(e.to_string()))?;
        let place = Place { file: file.map(Arc::from), folder: folder.into(), line: 0 };
        let ends: Vec<usize> = document.input_text().match_indices('\n').map(|(at, _)| at).collect();
        self.element(&document.root_element(), &place, &ends, depth)
    }

    /// Converts an XML node to an element. `ends`: byte positions of the line ends in the text.
    fn element(&mut self, node: &Node, at: &Place, ends: &[usize], depth: usize) -> Result<Element, UrdfError> {
        let start = node.range().start;
        let place = Place { line: 1 + ends.partition_point(|end| *end < start) as u32, ..at.clone() };
        let attributes = node.attributes().map(|a| (a.name().to_string(), a.value().to_string())).collect();
        let mut own = Element { tag: node.tag_name().name().into(), place, attributes, children: Vec::new() };
        for child in node.children().filter(Node::is_element) {
            let child = self.element(&child, at, ends, depth)?;
            if child.tag == "include" {
                own.children.extend(self.included(&child, depth)?)
            } else {
                own.children.push(child)
            }
        }
        Ok(own)
    }

    /// The elements of an included file: the children of its root.
    fn included(&mut self, include: &Element, depth: usize) -> Result<Vec<Element>, UrdfError> {
        let name = include.word("file").ok_or_else(|| include.refused("it names no file"))?;
        if depth == MAX_INCLUDE_DEPTH {
            return Err(include.refused("files that include each other"));
        }
        // The path is relative to the main file, or else to the including file.
        let paths = [self.folder, &include.place.folder].map(|folder| folder.join(name));
        let path = paths.iter().find(|path| path.is_file()).unwrap_or(&paths[0]);
        if !self.seen.insert(std::fs::canonicalize(path).unwrap_or_else(|_| path.clone())) {
            return Err(include.refused("the file is included twice"));
        }
        let text = read_text(path).map_err(|e| include.refused(e))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        Ok(self.parse(&text, Some(name), &folder, depth + 1)?.children)
    }
}
