//! Elements and attributes of MJCF, from MuJoCo's schema; anything else is refused as misspelt.

use std::collections::HashMap;
use std::sync::LazyLock;

use super::element::Element;
use super::values::{Value, value_of};
use crate::internal::*;

/// An element of the schema.
struct Known {
    /// Whether a parent has at most one such child (suffix `?` in the schema).
    once: bool,
    attributes: HashMap<&'static str, &'static Value>,
    choices: Vec<Choice>,
    children: HashMap<&'static str, usize>,
}

/// Alternative attributes: at most one may be present (`a|b`), or exactly one must be (`a!`, `a|b!`). Attributes joined
/// by `&` occur together or not at all (`a&b`).
struct Choice {
    needed: bool,
    of: Vec<Vec<&'static str>>,
}

impl Choice {
    fn read(word: &'static str) -> Option<Self> {
        let of = word.trim_end_matches('!');
        word.contains(['|', '&', '!'])
            .then(|| Self { needed: of != word, of: of.split('|').map(|one| one.split('&').collect()).collect() })
    }

    fn check(&self, e: &Element, known: &Known) -> Result<(), UrdfError> {
        let quoted =
            |keys: &[&str], between: &str| keys.iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(between);
        let given: Vec<_> = self.of.iter().filter(|keys| keys.iter().any(|key| e.has(key))).collect();
        match given[..] {
            [] if self.needed => {
                let all = self.of.iter().map(|keys| quoted(keys, " and ")).collect::<Vec<_>>().join(", or ");
                Err(e.refused(format!("it needs {all}")))
            }
            [keys] => {
                let says = |key: &&&str| {
                    let text = e.text(key).unwrap_or_default();
                    // An empty name or list has no effect.
                    let empty = match known.attributes.get(**key) {
                        Some(Value::Named(_)) => text.is_empty(),
                        Some(Value::Numbers { .. }) => self.needed && text.trim().is_empty(),
                        _ => false,
                    };
                    e.has(key) && !empty
                };
                let (with, without): (Vec<&str>, Vec<&str>) = keys.iter().partition(|key| says(key));
                match without.is_empty() {
                    true => Ok(()),
                    false if with.is_empty() => {
                        Err(e.refused(format!("its {} is empty; write one", quoted(&without, " and "))))
                    }
                    false => Err(e.refused(format!(
                        "it has {} without {}; write both, or neither",
                        quoted(&with, " and "),
                        quoted(&without, " and ")
                    ))),
                }
            }
            [] => Ok(()),
            _ => {
                let said: Vec<&str> = given.into_iter().flatten().copied().filter(|key| e.has(key)).collect();
                Err(e.refused(format!("{} exclude each other; write one", quoted(&said, " and "))))
            }
        }
    }
}

/// Each line is an element, with its children indented below; the first line is the root.
static SCHEMA: LazyLock<Vec<Known>> = LazyLock::new(|| {
    let mut all = Vec::<Known>::new();
    let mut path = Vec::<usize>::new();
    for line in include_str!("schema.txt").lines() {
        let depth = line.len() - line.trim_start().len();
        let mut words = line.split_whitespace();
        let (tag, often) = words.next().map(|word| word.split_at(word.len() - 1)).unwrap_or_default();
        let words: Vec<&str> = words.collect();
        path.truncate(depth);
        if let Some(above) = path.last() {
            let new = all.len();
            all[*above].children.insert(tag, new);
        }
        path.push(all.len());
        let keys = words.iter().flat_map(|word| word.split(['|', '&', '!'])).filter(|key| !key.is_empty());
        all.push(Known {
            once: often == "?",
            attributes: keys.map(|key| (key, value_of(tag, key))).collect(),
            choices: words.into_iter().filter_map(Choice::read).collect(),
            children: HashMap::new(),
        });
        // Bodies, frames, replicas and default classes nest.
        let own = all.len() - 1;
        if ["body", "default", "frame", "replicate"].contains(&tag) {
            all[own].children.insert(tag, own);
        }
    }
    all
});

/// Refuses unknown elements and attributes, attributes with wrong content, missing attributes, and elements that occur
/// more often than allowed.
pub(super) fn check(root: &Element) -> Result<(), UrdfError> {
    let mut stack = vec![(root, 0)];
    while let Some((element, own)) = stack.pop() {
        let known = &SCHEMA[own];
        if let Some((key, _)) = element.attributes.first().filter(|_| element.tag == "worldbody") {
            return Err(element.refused(format!("the world has no attributes; leave `{}` out", key.escape_debug())));
        }
        for (key, text) in &element.attributes {
            let Some(value) = known.attributes.get(key.as_str()) else {
                let near = known.attributes.keys().filter(|other| strsim::osa_distance(key, other) <= 2).min();
                let near = near.map_or_else(String::new, |near| format!("; is `{near}` meant?"));
                return Err(element.refused(format!("an attribute `{}` is not known{near}", key.escape_debug())));
            };
            value.check(element, key, text)?;
        }
        known.choices.iter().try_for_each(|choice| choice.check(element, known))?;
        let mut seen = Vec::new();
        for child in &element.children {
            let tag = child.tag.as_str();
            // Children of a body may also be children of a frame in the body.
            let inside = if tag == "worldbody" { "body" } else { tag };
            let Some(next) = known.children.get(inside).or_else(|| within_body(&element.tag)?.children.get(inside))
            else {
                return Err(child.refused(format!("it is not known in <{}>", element.tag)));
            };
            if SCHEMA[*next].once && seen.contains(&tag) {
                return Err(child.refused(format!("<{}> has two; leave one out", element.tag)));
            }
            seen.push(tag);
            stack.push((child, *next));
        }
    }
    Ok(())
}

fn within_body(tag: &str) -> Option<&'static Known> {
    let body = SCHEMA[0].children.get("body")?;
    ["frame", "replicate"].contains(&tag).then(|| &SCHEMA[*body])
}
