//! Circles of imports within a crate, between files and folders, from its parsed sources.
//!
//! A file leads to each file that defines something it uses; `mod` declarations and re-exports are followed but lead nowhere
//! themselves. A use counts between the two names at which the files' paths part: two files of a folder, or folders.

mod read;
mod resolve;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use resolve::{Use, uses};

/// Uses of an edge that a line names.
const SHOWN: usize = 4;

/// One line for each circle in a workspace's crates.
pub fn of_workspace(root: &Path) -> Result<Vec<String>> {
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).with_context(|| format!("no Cargo.toml in {}", root.display()))?;
    let manifest: toml::Table = toml::from_str(&manifest)?;
    let members = manifest["workspace"]["members"].as_array().context("no workspace.members in Cargo.toml")?;
    let mut lines = Vec::new();
    for member in members.iter().filter_map(toml::Value::as_str) {
        for entry in ["lib.rs", "main.rs"] {
            let entry = root.join(member).join("src").join(entry);
            if entry.is_file() {
                lines.extend(of_crate(&entry)?.into_iter().map(|line| format!("{member}, {line}")));
            }
        }
    }
    Ok(lines)
}

/// One line for each circle in a crate.
pub fn of_crate(entry: &Path) -> Result<Vec<String>> {
    let src = entry.parent().unwrap_or(Path::new(""));
    let mut uses = uses(&read::read(entry)?, src);
    // A module may be a file beside its folder: `a.rs` is then the folder's own.
    let folders: BTreeSet<PathBuf> = uses.iter().flat_map(|u| [&u.from, &u.to]).filter_map(|p| Some(p.parent()?.to_path_buf())).collect();
    for path in uses.iter_mut().flat_map(|u| [&mut u.from, &mut u.to]) {
        if folders.contains(&path.with_extension("")) {
            *path = path.with_extension("").join("mod.rs");
        }
    }
    let (mut graph, mut behind) = (Graph::new(), BTreeMap::<_, Vec<&Use>>::new());
    for used in &uses {
        let [from, to] = parted(&used.from, &used.to);
        *graph.entry(from.clone()).or_default().entry(to.clone()).or_default() += 1;
        behind.entry((from, to)).or_default().push(used);
    }
    let line = |circle: Vec<String>| {
        let (first, last) = (circle[0].clone(), circle[circle.len() - 1].clone());
        let all = &behind[&(last, first.clone())];
        let closing: Vec<_> = all.iter().take(SHOWN).map(|u| format!("{}:{} {}", u.from.display(), u.line, u.path)).collect();
        let more = if all.len() > SHOWN { format!(" and {} more", all.len() - SHOWN) } else { String::new() };
        format!("{} -> {first}, closed by {}{more}", circle.join(" -> "), closing.join(", "))
    };
    Ok(circles(&graph).into_iter().map(line).collect())
}

/// The names at which two paths part.
fn parted(from: &Path, to: &Path) -> [String; 2] {
    let same = from.iter().zip(to.iter()).take_while(|(a, b)| a == b).count();
    [from, to].map(|path| path.iter().take(same + 1).collect::<PathBuf>().display().to_string())
}

/// Edges from a name to names, each with how many uses it has.
type Graph = BTreeMap<String, BTreeMap<String, usize>>;

/// The shortest circle through each name, once; its last step, back to its first name, is the one of fewest uses.
fn circles(graph: &Graph) -> BTreeSet<Vec<String>> {
    let mut all = BTreeSet::new();
    for mut circle in graph.keys().filter_map(|name| shortest(graph, name)) {
        let n = circle.len();
        let uses = |k: usize| (graph[&circle[k]][&circle[(k + 1) % n]], &circle[k]);
        let fewest = (0..n).min_by_key(|k| uses(*k)).unwrap_or(0);
        circle.rotate_left((fewest + 1) % n);
        all.insert(circle);
    }
    all
}

fn shortest(graph: &Graph, start: &String) -> Option<Vec<String>> {
    let (mut before, mut open) = (BTreeMap::<&String, &String>::new(), VecDeque::from([start]));
    while let Some(name) = open.pop_front() {
        for next in graph.get(name).into_iter().flat_map(BTreeMap::keys) {
            if next == start {
                let mut way = vec![name.clone()];
                while let Some(last) = before.get(way.last()?) {
                    way.push(last.to_string());
                }
                way.reverse();
                return Some(way);
            }
            if !before.contains_key(next) {
                before.insert(next, name);
                open.push_back(next);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A crate with the files given, each with its path and text; the lines of its circles.
    fn circles_of(files: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        for (path, text) in files {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("folders");
            std::fs::write(path, text).expect("a file");
        }
        of_crate(&folder.path().join("lib.rs")).expect("a crate that parses")
    }

    const OWN: &str = "pub struct Own;\npub use self::deep::Deep;\nmod deep;\n";

    #[test]
    fn a_circle_is_found_through_a_reexport_and_in_a_macro() {
        let lib = ("lib.rs", "mod body;\npub mod name;\npub use body::Own;\n");
        let (body, deep) = (("body/mod.rs", OWN), ("body/deep.rs", "use crate::name::Name;\npub struct Deep(Name);\n"));
        // Through the re-export at the root, inside a macro.
        let name =
            ("name.rs", "#[derive(Debug)]\npub struct Name;\npub fn print() {\n    println!(\"{:?}\", crate::body::Deep::of(1));\n}\n");
        let end = "closed by name.rs:4 crate::body::Deep::of";
        assert_eq!(circles_of(&[lib, body, deep, name]), [format!("body -> name.rs -> body, {end}")]);
    }

    #[test]
    fn one_of_folders_alone_is_found() {
        let a = [("lib.rs", "mod a;\nmod b;\n"), ("a/mod.rs", "pub mod low;\npub mod high;\n"), ("a/low.rs", "pub struct Low;\n")];
        let b = [("a/high.rs", "use crate::b::*;\npub type High = Mid;\n"), ("b.rs", "use super::a::low;\npub struct Mid(low::Low);\n")];
        let files = [a, [b[0], b[1], ("unused.rs", "")]].concat();
        assert_eq!(circles_of(&files), ["b.rs -> a -> b.rs, closed by a/high.rs:2 Mid"]);
    }

    #[test]
    fn tests_declarations_and_reexports_close_none() {
        let lib = ("lib.rs", "mod a;\nmod b;\npub use b::Second;\n#[cfg(test)]\nmod tests { use super::b::Second; }\n");
        let a = ("a.rs", "pub struct First;\n#[cfg(test)]\nmod tests {\n    use crate::Second;\n}\n");
        let b =
            ("b.rs", "use crate::a::First;\npub struct Second(First);\npub fn number() -> usize {\n    let second = 2;\n    second\n}\n");
        assert_eq!(circles_of(&[lib, a, b]), [""; 0]);
    }
}
