//! From a path to the files that define what it names, through imports and re-exports.

use std::path::{Path, PathBuf};

use super::read::{Module, Name};

#[derive(PartialEq, Eq, PartialOrd, Ord)]
pub struct Use {
    pub from: PathBuf,
    pub to: PathBuf,
    pub line: usize,
    pub path: String,
}

/// What a path leads to: a module, or something that the module defines.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Target {
    Module(usize),
    In(usize),
}

/// All uses between two files of a crate, with paths below `src`.
pub fn uses(modules: &[Module], src: &Path) -> Vec<Use> {
    let below = |id: usize| modules[id].file.strip_prefix(src).unwrap_or(&modules[id].file).to_path_buf();
    let mut all = Vec::new();
    for (id, module) in modules.iter().enumerate() {
        for used in module.used.iter().chain(&module.globs) {
            for target in resolve(modules, id, &used.path, &mut Vec::new()) {
                let Target::In(home) = target else { continue };
                if modules[home].file != module.file {
                    all.push(Use { from: below(id), to: below(home), line: used.line, path: used.path.join("::") });
                }
            }
        }
    }
    all.sort();
    all.dedup();
    all
}

fn resolve(modules: &[Module], from: usize, path: &[String], seen: &mut Vec<(usize, String)>) -> Vec<Target> {
    let Some((first, rest)) = path.split_first() else { return Vec::new() };
    let mut targets = match first.as_str() {
        "crate" => vec![Target::Module(0)],
        "self" => vec![Target::Module(from)],
        "super" => modules[from].parent.map(Target::Module).into_iter().collect(),
        name => lookup(modules, from, name, seen),
    };
    for name in rest {
        let step = |target: Target| match target {
            Target::Module(id) if name == "super" => modules[id].parent.map(Target::Module).into_iter().collect(),
            Target::Module(id) => lookup(modules, id, name, seen),
            // A variant or an associated function: its type's home.
            Target::In(id) => vec![Target::In(id)],
        };
        targets = targets.into_iter().flat_map(step).collect();
    }
    targets
}

fn lookup(modules: &[Module], id: usize, name: &str, seen: &mut Vec<(usize, String)>) -> Vec<Target> {
    let key = (id, name.to_string());
    if seen.contains(&key) {
        return Vec::new();
    }
    seen.push(key);
    let module = &modules[id];
    let mut targets = Vec::new();
    for meaning in module.names.get(name).into_iter().flatten() {
        match meaning {
            Name::Module(child) => targets.push(Target::Module(*child)),
            Name::Item => targets.push(Target::In(id)),
            Name::Import(path) => targets.extend(resolve(modules, id, path, seen)),
        }
    }
    for glob in module.globs.iter().filter(|_| !module.names.contains_key(name)) {
        for target in resolve(modules, id, &glob.path, seen) {
            if let Target::Module(other) = target {
                targets.extend(lookup(modules, other, name, seen));
            }
        }
    }
    seen.pop();
    targets
}
