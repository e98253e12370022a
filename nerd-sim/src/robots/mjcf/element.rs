//! Elements of an MJCF with their positions in the text, and access to attributes as numbers and words.

use std::sync::Arc;

use crate::internal::*;

/// Largest magnitude of a number, except for ends of ranges.
const MAX_MAGNITUDE: f64 = 1e15;

/// `text` shortened to one line, for errors.
pub(super) fn brief(text: &str) -> String {
    let end = text.char_indices().nth(60).map_or(text.len(), |(end, _)| end);
    format!("{}{}", text[..end].escape_debug(), if end < text.len() { ".." } else { "" })
}

/// Position of an element in the text of its file.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// Name of the included file; `None` for the main file.
    pub file: Option<Arc<str>>,
    /// Folder of this file.
    pub folder: Arc<Path>,
    /// Line, from 1.
    pub line: u32,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.file.as_ref().map_or(Ok(()), |file| write!(f, "{file}, "))?;
        write!(f, "line {}", self.line)
    }
}

/// An element with attributes and children; comments and text between elements are dropped.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub tag: String,
    pub place: Place,
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

impl Element {
    /// An error with position, tag and name of the element.
    pub fn refused(&self, reason: impl std::fmt::Display) -> UrdfError {
        let name = ["name", "class", "joint", "file"].into_iter().find_map(|key| self.text(key));
        let name = name.map_or_else(String::new, |name| format!(" `{}`", brief(name)));
        UrdfError::Refused(format!("{}, <{}>{name}: {reason}", self.place, self.tag))
    }

    pub fn text(&self, key: &str) -> Option<&str> {
        self.attributes.iter().find(|(own, _)| own == key).map(|(_, value)| value.as_str())
    }

    /// The text of an attribute, unless it is empty.
    pub fn word(&self, key: &str) -> Option<&str> {
        self.text(key).filter(|text| !text.is_empty())
    }

    pub fn has(&self, key: &str) -> bool {
        self.text(key).is_some()
    }

    pub fn all<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |child| child.tag == tag)
    }

    /// The numbers of an attribute, whose count the schema has checked; `None` if there are none.
    pub fn list(&self, key: &str) -> Result<Option<Vec<f64>>, UrdfError> {
        let numbers = self.text(key).unwrap_or_default().split_whitespace().map(|word| {
            let number = word
                .parse::<f64>()
                .ok()
                .filter(|x| x.abs() <= MAX_MAGNITUDE || x.is_infinite() && key.ends_with("range"));
            number.ok_or_else(|| {
                self.refused(format!("{key}: `{}` is not a number up to {MAX_MAGNITUDE:e}", brief(word)))
            })
        });
        Ok(Some(numbers.collect::<Result<Vec<_>, _>>()?).filter(|numbers| !numbers.is_empty()))
    }

    pub fn array<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>, UrdfError> {
        Ok(self.list(key)?.and_then(|all| all.try_into().ok()))
    }

    pub fn number(&self, key: &str) -> Result<Option<f64>, UrdfError> {
        Ok(self.array::<1>(key)?.map(|[x]| x))
    }

    /// Overwrites `numbers` with the numbers of an attribute, from the first; the rest stay unchanged.
    pub fn fill(&self, key: &str, numbers: &mut [f64]) -> Result<(), UrdfError> {
        let given = self.list(key)?.unwrap_or_default();
        numbers.iter_mut().zip(given).for_each(|(own, x)| *own = x);
        Ok(())
    }

    /// Overwrites a number with the number of an attribute, if present.
    pub fn set(&self, key: &str, number: &mut f64) -> Result<(), UrdfError> {
        self.fill(key, std::slice::from_mut(number))
    }

    pub fn whole(&self, key: &str) -> Result<Option<i64>, UrdfError> {
        Ok(self.number(key)?.map(|x| x as i64))
    }

    /// The value paired with the attribute's word; the schema has checked the word.
    pub fn one_of<T: Copy>(&self, key: &str, words: &[(&str, T)]) -> Option<T> {
        let text = self.text(key)?;
        words.iter().find(|(word, _)| *word == text).map(|(_, value)| *value)
    }

    pub fn flag(&self, key: &str) -> Option<bool> {
        self.one_of(key, &[("true", true), ("false", false)])
    }

    /// `true`, `false` or `auto`; the inner `None` is `auto`.
    pub fn tristate(&self, key: &str) -> Option<Option<bool>> {
        self.one_of(key, &[("true", Some(true)), ("false", Some(false)), ("auto", None)])
    }
}
