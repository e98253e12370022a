//! Checks names of a model's objects: unique within a kind, and each reference must exist.

use std::collections::HashSet;

use super::element::{Element, brief};
use super::scope::Scope;
use super::values::{Value, value_of};
use crate::internal::*;

/// Sections of a file in which all elements count as one kind, so that they share one set of names.
const KINDS: [&str; 4] = ["actuator", "equality", "sensor", "tendon"];
/// Kinds of assets that need a name.
const ASSETS: [&str; 4] = ["hfield", "material", "mesh", "texture"];

#[derive(Default)]
pub(super) struct Names {
    known: HashSet<(String, String)>,
    /// `copied`: kinds and names of replicated objects, without suffix. `suffixes`: the suffixes of replicas.
    copied: HashSet<(String, String)>,
    suffixes: HashSet<String>,
    /// References to be checked: kind and name of the object, referring element, attribute.
    asked: Vec<((String, String), Element, String)>,
    once: HashSet<(String, String)>,
}

impl Names {
    /// Adds an object; returns whether its name is new among its kind.
    pub fn add(&mut self, kind: &str, name: &str, scope: &Scope) -> bool {
        let at = &scope.at;
        let own = |name: String| (kind.to_string(), name);
        if !at.suffix.is_empty() {
            self.copied.insert(own(format!("{}{name}", at.prefix)));
            if !self.suffixes.contains(&at.suffix) {
                self.suffixes.insert(at.suffix.clone());
            }
        }
        self.known.insert(own(at.name(name)))
    }

    fn ask(&mut self, e: &Element, [kind, name, key]: [&str; 3], scope: &Scope) {
        let name =
            if [kind, name] == ["body", "world"] { name.to_string() } else { format!("{}{name}", scope.at.prefix) };
        let asked = (kind.to_string(), name);
        if self.once.insert(asked.clone()) {
            self.asked.push((asked, Element { children: Vec::new(), ..e.clone() }, key.into()));
        }
    }

    /// Refuses a reference to a missing object; the original name of replicas refers to all of them.
    pub fn check(&self) -> Result<(), UrdfError> {
        let there = |(kind, name): &(String, String)| {
            let copy = |suffix: &String| {
                name.strip_suffix(suffix).is_some_and(|own| self.known.contains(&(kind.clone(), own.into())))
            };
            self.known.contains(&(kind.clone(), name.clone()))
                || self.copied.contains(&(kind.clone(), name.clone()))
                || self.suffixes.iter().any(copy)
        };
        let Some(((kind, name), e, key)) = self.asked.iter().find(|(asked, ..)| !there(asked)) else { return Ok(()) };
        let alike = self.known.iter().filter(|(other, _)| other == kind).map(|(_, other)| other);
        let near = alike.filter(|other| strsim::osa_distance(&brief(name), other) <= 2).min();
        let near = near.map_or_else(String::new, |near| format!("; is `{}` meant?", near.escape_debug()));
        Err(e.refused(format!("{key}=\"{}\": there is no such {}{near}", brief(name), kind.replace('-', " "))))
    }

    /// Registers the name of an element in a section or body, and the names that the element or its default class
    /// refers to. `attached`: the element is part of an attached model.
    pub fn take(&mut self, e: &Element, section: &str, scope: &Scope, attached: bool) -> Result<(), UrdfError> {
        let source = &scope.source;
        let tag = e.tag.as_str();
        let kind = if KINDS.contains(&section) { section } else { tag };
        let kind = if kind == "freejoint" { "joint" } else { kind };
        // An attached model brings all its sections; references in them may be missing.
        let part = attached && section != "body";
        let stem =
            || e.word("file").filter(|_| ASSETS.contains(&tag)).and_then(|file| Path::new(file).file_stem()?.to_str());
        match e.word("name").or_else(stem) {
            Some(name) if !self.add(kind, name, scope) && !part => {
                return Err(e.refused(format!("another {kind} is called `{}`, too", brief(&scope.at.name(name)))));
            }
            None if ASSETS.contains(&tag) && e.text("type") != Some("skybox") => {
                return Err(e.refused("it needs a name"));
            }
            _ => {}
        }
        let given = e.text("user").map_or(0, |text| text.split_whitespace().count());
        if let Some(most) = source.users.get(kind).filter(|most| given > **most) {
            return Err(e.refused(format!("user has {given} numbers, and <size> lets a {kind} have {most}")));
        }
        let mut said: Vec<(&str, &str)> =
            e.attributes.iter().map(|(key, text)| (key.as_str(), text.as_str())).collect();
        if !section.is_empty() && !["body", "frame", "replicate", "attach"].contains(&tag) {
            let class = source.classes.of(e, scope.class.as_deref().filter(|_| section == "body"))?;
            let own = |of: &str| of == tag || of == section;
            said.extend(
                class
                    .names
                    .iter()
                    .filter(|((of, key), _)| own(of) && !e.has(key))
                    .map(|((_, key), text)| (key.as_str(), text.as_str())),
            );
        }
        for (key, text) in said {
            match value_of(tag, key) {
                Value::Named("class") if source.classes.has(text) => {}
                Value::Named("class") => return Err(e.refused(format!("there is no default class `{}`", brief(text)))),
                Value::Named(kind) if !part && !text.is_empty() => {
                    // The kind of such an object is the value of another attribute.
                    let kind = if kind.ends_with("type") { e.text(kind).unwrap_or_default() } else { kind };
                    let kind = if kind == "xbody" { "body" } else { kind };
                    self.ask(e, [kind, text, key], scope);
                }
                _ => {}
            }
        }
        if section != "body" {
            e.children.iter().try_for_each(|child| self.take(child, "", scope, attached))?;
        }
        Ok(())
    }
}
