//! Old names in users' files, read for one version with a line on standard error that has the new ones.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::Write as _;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use toml::de::{DeTable, DeValue};

/// Kind of a user's file, or of names in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A robot's TOML.
    Robot,
    /// A log's TOML.
    Log,
    /// A task's TOML.
    Task,
    /// Words and functions in a task's expressions.
    Word,
    /// Commands of the tasks `walk` and `rough`.
    Command,
    /// Settings of policy training.
    Ppo,
    /// The network in a policy's `config.json`.
    Shape,
    /// A line of a policy run's `metrics.jsonl`.
    Metrics,
}

/// Kind, table, old name, new name. A dot separates nested tables; a list stands for each of its tables.
/// [`crate::prelude::System::sha256`] is taken over the old names of robots' keys, so that hashes stay.
const NAMES: &[(Kind, &str, &str, &str)] = &[
    (Kind::Robot, "joint", "default", "default_q"),
    (Kind::Robot, "control", "ahead", "stable_pd"),
    (Kind::Robot, "root.sample", "angular", "ang_vel"),
    (Kind::Robot, "root.sample", "linear", "velocity"),
    (Kind::Robot, "root.reset", "angular", "ang_vel"),
    (Kind::Robot, "root.reset", "linear", "velocity"),
    (Kind::Robot, "scene.box", "at", "position"),
    (Kind::Robot, "scene.box", "turn", "yaw"),
    (Kind::Robot, "scene.peg", "at", "position"),
    (Kind::Robot, "random_pegs", "at", "position"),
    (Kind::Robot, "vary", "turn_noise", "orientation_noise"),
    (Kind::Robot, "cable", "held", "support"),
    (Kind::Robot, "cable", "at", "position"),
    (Kind::Robot, "cable", "along", "direction"),
    (Kind::Log, "root", "angular", "ang_vel"),
    (Kind::Task, "", "over", "terminated"),
    (Kind::Task, "", "miss", "error"),
    (Kind::Task, "", "allowed", "tolerance"),
    (Kind::Word, "", "rest", "default_q"),
    (Kind::Word, "", "most", "torque_limit"),
    (Kind::Word, "", "spin", "ang_vel"),
    (Kind::Word, "", "world_spin", "world_ang_vel"),
    (Kind::Word, "", "rest_tool", "default_tool"),
    (Kind::Word, "", "scan", "height_scan"),
    (Kind::Command, "", "ahead", "vx"),
    (Kind::Command, "", "aside", "vy"),
    (Kind::Command, "", "turn", "yaw_rate"),
    (Kind::Ppo, "", "rate", "learning_rate"),
    (Kind::Ppo, "", "kl", "target_kl"),
    (Kind::Ppo, "", "clip", "clip_coef"),
    (Kind::Ppo, "", "entropy", "ent_coef"),
    (Kind::Ppo, "", "bounds", "bounds_coef"),
    (Kind::Ppo, "", "spread", "init_noise_std"),
    (Kind::Ppo, "", "spread_by_state", "state_dependent_std"),
    (Kind::Shape, "", "spread_by_state", "state_dependent_std"),
    (Kind::Metrics, "", "rate", "learning_rate"),
];

/// An old name and its new one.
pub type Renamed = (&'static str, &'static str);

fn names(kind: Kind) -> impl Iterator<Item = (&'static str, Renamed)> {
    NAMES.iter().filter(move |row| row.0 == kind).map(|&(_, table, old, new)| (table, (old, new)))
}

/// The new name of `old`, among names without tables.
pub fn renamed(kind: Kind, old: &str) -> Option<Renamed> {
    names(kind).map(|(_, name)| name).find(|name| name.0 == old)
}

/// Prints one line with the names to use in `what`; once per process for equal lines.
pub fn note(what: &str, found: impl IntoIterator<Item = Renamed>) {
    static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut line = String::new();
    for (old, new) in found.into_iter().collect::<BTreeSet<_>>() {
        let _ = write!(line, "{} `{new}` for `{old}`", if line.is_empty() { " write" } else { "," });
    }
    let line = format!("note: {what}: old names are read for this version only:{line}");
    if !line.ends_with(':') && TOLD.lock().unwrap_or_else(PoisonError::into_inner).insert(line.clone()) {
        // A closed pipe is ignored.
        let _ = writeln!(std::io::stderr().lock(), "{line}");
    }
}

/// The text of a TOML with new keys for old ones, and the keys that were renamed. Lines stay; a text that is no TOML is
/// returned unchanged.
///
/// # Errors
/// If a table has the old and the new name of a key.
pub fn toml(kind: Kind, text: &str) -> Result<(String, Vec<Renamed>), String> {
    let mut places = Vec::new();
    if let Ok(document) = DeTable::parse(text) {
        for (table, name) in names(kind) {
            let path: Vec<&str> = table.split('.').filter(|part| !part.is_empty()).collect();
            find(document.get_ref(), &path, name, &mut places)?;
        }
    }
    places.sort_by_key(|(span, _)| std::cmp::Reverse(span.start));
    let mut text = text.to_string();
    places.iter().for_each(|(span, name)| text.replace_range(span.clone(), name.1));
    Ok((text, places.into_iter().map(|(_, name)| name).collect()))
}

/// Collects the places of a key in the tables at `path`.
fn find(
    table: &DeTable,
    path: &[&str],
    name: Renamed,
    places: &mut Vec<(Range<usize>, Renamed)>,
) -> Result<(), String> {
    let Some((first, rest)) = path.split_first() else {
        let old = table.keys().find(|key| key.get_ref() == name.0);
        if let Some(old) = old {
            twice(name, table.keys().any(|key| key.get_ref() == name.1))?;
            places.push((old.span(), name));
        }
        return Ok(());
    };
    let Some((_, inner)) = table.iter().find(|(key, _)| key.get_ref() == first) else { return Ok(()) };
    match inner.get_ref() {
        DeValue::Table(inner) => find(inner, rest, name, places),
        DeValue::Array(all) => all.iter().try_for_each(|item| match item.get_ref() {
            DeValue::Table(inner) => find(inner, rest, name, places),
            _ => Ok(()),
        }),
        _ => Ok(()),
    }
}

fn twice((old, new): Renamed, both: bool) -> Result<(), String> {
    if both {
        Err(format!("`{old}` is the old name of `{new}`, and both are given; leave `{old}` out"))
    } else {
        Ok(())
    }
}

/// Gives old keys of a JSON object their new names; returns the keys that were renamed.
///
/// # Errors
/// If the object has the old and the new name of a key.
pub fn json(kind: Kind, object: &mut serde_json::Value) -> Result<Vec<Renamed>, String> {
    let Some(map) = object.as_object_mut() else { return Ok(Vec::new()) };
    let mut found = Vec::new();
    for (_, name) in names(kind) {
        if let Some(value) = map.remove(name.0) {
            twice(name, map.contains_key(name.1))?;
            map.insert(name.1.into(), value);
            found.push(name);
        }
    }
    Ok(found)
}

/// Gives the keys of a robot's specification their old names, over which hashes are taken.
pub(crate) fn hashed(spec: &mut serde_json::Value) {
    for (table, (old, new)) in names(Kind::Robot) {
        let mut tables = vec![&mut *spec];
        for part in table.split('.') {
            let inner = tables.into_iter().filter_map(|table| table.get_mut(part));
            tables = inner.flat_map(|inner| if inner.is_array() { all(inner) } else { vec![inner] }).collect();
        }
        for map in tables.into_iter().filter_map(serde_json::Value::as_object_mut) {
            if let Some(value) = map.remove(new) {
                map.insert(old.into(), value);
            }
        }
    }
}

fn all(list: &mut serde_json::Value) -> Vec<&mut serde_json::Value> {
    list.as_array_mut().into_iter().flatten().collect()
}
