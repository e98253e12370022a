//! Finds import cycles within a crate, between files and between folders, from the tokens of its sources.
//!
//! An edge leads from a file to each file that defines a name it uses. Re-exports are followed and add no edge; tests
//! are left out. An edge connects the first path components that differ: two files of one folder, or two folders.

use std::collections::BTreeSet;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

use crate::{prelude::*, report::below};

/// Largest number of re-exports that are followed for one name.
const DEEP: usize = 20;
/// Keywords before the name of an item that a module defines.
const DEFINE: [&str; 8] = ["const", "enum", "fn", "static", "struct", "trait", "type", "mod"];

/// A module: a file or an inline `mod`. A name may mean several things, such as a module and a function.
#[derive(Default)]
struct Module {
    file: PathBuf,
    parent: usize,
    children: BTreeMap<String, usize>,
    defined: BTreeSet<String>,
    /// Imported names (`*` for a glob) and their paths.
    imports: Vec<(String, Vec<String>)>,
    /// Paths that the code uses, as (line number, path).
    used: BTreeSet<(usize, Vec<String>)>,
}

/// Target of a path: a module, or an item in the module that defines it.
#[derive(Clone, Copy)]
enum Target {
    Module(usize),
    In(usize),
}

/// Lists the edges of import cycles in all crates of a workspace, one line each.
pub fn of_workspace(root: &Path) -> Result<Vec<String>> {
    let manifest = std::fs::read_to_string(root.join("Cargo.toml"))
        .with_context(|| format!("no Cargo.toml in {}", root.display()))?;
    let manifest: toml::Table = toml::from_str(&manifest)?;
    let members = manifest["workspace"]["members"].as_array().context("no workspace.members in Cargo.toml")?;
    let mut lines = Vec::new();
    for member in members.iter().filter_map(toml::Value::as_str) {
        lines.extend(of_crate(&root.join(member).join("src"))?.into_iter().map(|line| format!("{member}, {line}")));
    }
    Ok(lines)
}

/// Lists the edges of import cycles in a crate's sources, one line each.
fn of_crate(src: &Path) -> Result<Vec<String>> {
    let modules = read(src)?;
    let mut graph = Graph::new();
    for (id, module) in modules.iter().enumerate() {
        for (line, path) in &module.used {
            for target in resolve(&modules, id, path, 0) {
                let Target::In(home) = target else { continue };
                if modules[home].file != module.file {
                    let [from, to] = parted(&module.file, &modules[home].file);
                    let used = format!("{}:{line} {}", module.file.display(), path.join("::"));
                    graph.entry(from).or_default().entry(to).or_default().insert(used);
                }
            }
        }
    }
    let lines = |(from, all): (String, BTreeMap<String, BTreeSet<String>>)| {
        all.into_iter().map(move |(to, uses)| format!("{from} -> {to} by {}", uses.iter().join(", ")))
    };
    Ok(circling(graph).into_iter().flat_map(lines).collect())
}

/// Parses all files below `src` into modules; the crate's root is the first.
fn read(src: &Path) -> Result<Vec<Module>> {
    let mut modules = vec![Module::default()];
    for path in below(src)?.into_iter().filter(|path| path.extension().is_some_and(|e| e == "rs")) {
        let text = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let tokens = text.parse::<TokenStream>().map_err(|e| anyhow!("{}: {e}", path.display()))?;
        let file = path.strip_prefix(src).unwrap_or(&path);
        let mut names = file.with_extension("").iter().map(|name| name.to_string_lossy().into_owned()).collect_vec();
        names.pop_if(|name| ["lib", "main", "mod"].contains(&name.as_str()));
        let id = names.iter().fold(0, |above, name| child(&mut modules, above, name));
        modules[id].file = file.into();
        scan(&mut modules, id, &tokens.into_iter().collect_vec(), true);
    }
    Ok(modules)
}

/// The child module with this name, added if missing.
fn child(modules: &mut Vec<Module>, above: usize, name: &str) -> usize {
    let new = modules.len();
    let file = modules[above].file.clone();
    let id = *modules[above].children.entry(name.into()).or_insert(new);
    if id == new {
        modules.push(Module { file, parent: above, ..Module::default() });
    }
    id
}

/// Records the items, imports and uses in a module's tokens; `top` is false inside an item.
fn scan(modules: &mut Vec<Module>, id: usize, tokens: &[TokenTree], top: bool) {
    let word =
        |k: usize| if let Some(TokenTree::Ident(name)) = tokens.get(k) { name.to_string() } else { String::new() };
    let mark = |k: usize, mark: char| matches!(tokens.get(k), Some(TokenTree::Punct(found)) if found.as_char() == mark);
    let within = |k: usize, kind: Delimiter| match tokens.get(k) {
        Some(TokenTree::Group(group)) if group.delimiter() == kind => Some(group.stream().into_iter().collect_vec()),
        _ => None,
    };
    let path_sign = |k: usize| mark(k, ':') && mark(k + 1, ':');
    let mut k = 0;
    while k < tokens.len() {
        let name = word(k);
        let line = tokens[k].span().start().line;
        if mark(k, '#') && within(k + 1, Delimiter::Bracket).is_some_and(|attribute| of_tests(&attribute)) {
            // Skips to the end of the braces or to the semicolon.
            while k < tokens.len() && !mark(k, ';') && within(k, Delimiter::Brace).is_none() {
                k += 1;
            }
        } else if name == "use" {
            // Counts only private imports as uses; a re-export is none.
            let private = k == 0 || word(k - 1) != "pub" && within(k - 1, Delimiter::Parenthesis).is_none();
            let first = k + 1;
            while !mark(k, ';') && k < tokens.len() {
                k += 1;
            }
            for (line, name, path) in imported(&tokens[first..k], &[]) {
                modules[id].used.extend(private.then(|| (line, path.clone())));
                modules[id].imports.push((name, path));
            }
        } else if let (true, "mod", Some(inner)) = (top, &*name, within(k + 2, Delimiter::Brace)) {
            let inside = child(modules, id, &word(k + 1));
            scan(modules, inside, &inner, true);
            k += 2;
        } else if let TokenTree::Group(group) = &tokens[k] {
            scan(modules, id, &group.stream().into_iter().collect_vec(), false);
        } else if !name.is_empty() {
            // Excludes the keywords in `&'static Name` and `*const Name`, which define nothing.
            let defines = k == 0 || !mark(k - 1, '\'') && !mark(k - 1, '*');
            if top && defines && DEFINE.contains(&&*name) {
                modules[id].defined.insert(word(k + 1));
            }
            // A name after a dot or two colons belongs to another path. A lowercase name alone is a variable, unless it
            // is called.
            let inside = k > 0 && (mark(k - 1, '.') || k > 1 && path_sign(k - 2));
            let mut path = vec![name];
            while path_sign(k + 1) && !word(k + 3).is_empty() {
                k += 3;
                path.push(word(k));
            }
            let called = within(k + 1, Delimiter::Parenthesis).is_some() || mark(k + 1, '!');
            if !inside && (path.len() > 1 || path[0].starts_with(char::is_uppercase) || called) {
                modules[id].used.insert((line, path));
            }
        }
        k += 1;
    }
}

/// Whether an attribute marks an item as test code.
fn of_tests(attribute: &[TokenTree]) -> bool {
    match attribute {
        [TokenTree::Ident(name)] => name == "test",
        [TokenTree::Ident(name), TokenTree::Group(when)] => name == "cfg" && when.stream().to_string() == "test",
        _ => false,
    }
}

/// Line, name and path of each import in a `use`, below the path `above`.
fn imported(tokens: &[TokenTree], above: &[String]) -> Vec<(usize, String, Vec<String>)> {
    let one = |tokens: &[TokenTree]| {
        let mut path = above.to_vec();
        let line = tokens[0].span().start().line;
        for (k, token) in tokens.iter().enumerate() {
            match token {
                TokenTree::Group(group) => return imported(&group.stream().into_iter().collect_vec(), &path),
                TokenTree::Ident(name) if name == "as" => return vec![(line, tokens[k + 1].to_string(), path)],
                TokenTree::Punct(mark) if mark.as_char() == '*' => return vec![(line, "*".into(), path)],
                TokenTree::Ident(name) if path.is_empty() || name != "self" => path.push(name.to_string()),
                _ => {}
            }
        }
        vec![(line, path.last().cloned().unwrap_or_default(), path)]
    };
    let parts = tokens.split(|token| matches!(token, TokenTree::Punct(mark) if mark.as_char() == ','));
    parts.filter(|part| !part.is_empty()).flat_map(one).collect()
}

fn resolve(modules: &[Module], from: usize, path: &[String], deep: usize) -> Vec<Target> {
    let Some((first, rest)) = path.split_first().filter(|_| deep < DEEP) else { return Vec::new() };
    let mut targets = match first.as_str() {
        "crate" => vec![Target::Module(0)],
        "self" => vec![Target::Module(from)],
        "super" => vec![Target::Module(modules[from].parent)],
        name => lookup(modules, from, name, deep),
    };
    for name in rest {
        let step = |target| match target {
            Target::Module(id) if name == "super" => vec![Target::Module(modules[id].parent)],
            Target::Module(id) => lookup(modules, id, name, deep),
            // A variant or an associated function belongs to its type's module.
            Target::In(id) => vec![Target::In(id)],
        };
        targets = targets.into_iter().flat_map(step).collect();
    }
    targets
}

fn lookup(modules: &[Module], id: usize, name: &str, deep: usize) -> Vec<Target> {
    let module = &modules[id];
    let child = module.children.get(name).map(|child| Target::Module(*child));
    let own = (child.is_none() && module.defined.contains(name)).then_some(Target::In(id));
    let mut targets = child.into_iter().chain(own).collect_vec();
    for (known, path) in &module.imports {
        // Follows globs of this crate only.
        let own = ["crate", "self", "super"].contains(&&*path[0]) || module.children.contains_key(&path[0]);
        if known == name {
            targets.extend(resolve(modules, id, path, deep + 1));
        } else if known == "*" && own && targets.is_empty() {
            for target in resolve(modules, id, path, deep + 1) {
                if let Target::Module(other) = target {
                    targets.extend(lookup(modules, other, name, deep + 1));
                }
            }
        }
    }
    targets
}

/// Cuts two paths after the first component in which they differ.
fn parted(from: &Path, to: &Path) -> [String; 2] {
    let same = from.iter().zip(to.iter()).take_while(|(a, b)| a == b).count();
    [from, to].map(|path| path.iter().take(same + 1).collect::<PathBuf>().display().to_string())
}

/// Edges by source and target path, each with the uses that make it.
type Graph = BTreeMap<String, BTreeMap<String, BTreeSet<String>>>;

/// Removes nodes that lack incoming or outgoing edges, until no such node is left. Cycles and paths between cycles
/// remain.
fn circling(mut graph: Graph) -> Graph {
    loop {
        let before = graph.len();
        let led_to: BTreeSet<String> = graph.values().flat_map(BTreeMap::keys).cloned().collect();
        graph.retain(|from, _| led_to.contains(from));
        let leads: BTreeSet<String> = graph.keys().cloned().collect();
        graph.values_mut().for_each(|all| all.retain(|to, _| leads.contains(to)));
        graph.retain(|_, all| !all.is_empty());
        if graph.len() == before {
            return graph;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the lines of `of_crate` for a crate with these files (path, text).
    fn circles_of(files: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().expect("a folder");
        for (path, text) in files {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("folders");
            std::fs::write(path, text).expect("a file");
        }
        of_crate(folder.path()).expect("a crate that parses")
    }

    #[test]
    fn circles_are_found_through_reexports_macros_folders_and_preludes() {
        let lib = ("lib.rs", "mod body;\npub mod name;\npub use body::Own;\n");
        let body = ("body/mod.rs", "pub struct Own;\npub use self::deep::Deep;\nmod deep;\n");
        let deep = ("body/deep.rs", "use crate::name::Name;\npub struct Deep(Name);\n");
        // Uses `Deep` inside a macro, through the re-export in `body`.
        let name =
            ("name.rs", "pub struct Name;\npub fn print() {\n    println!(\"{:?}\", crate::body::Deep::of(1));\n}\n");
        let found = circles_of(&[lib, body, deep, name]);
        assert_eq!(
            found,
            [
                "body -> name.rs by body/deep.rs:1 crate::name::Name, body/deep.rs:2 Name",
                "name.rs -> body by name.rs:3 crate::body::Deep::of"
            ]
        );

        let lib = ("lib.rs", "mod a;\nmod b;\nmod prelude {\n    pub use crate::b::*;\n}\n");
        let a = [("a/mod.rs", "pub mod low;\npub mod high;\n"), ("a/low.rs", "pub struct Low;\n")];
        let high = ("a/high.rs", "use crate::prelude::*;\npub type High = Mid;\n");
        let b = ("b.rs", "use super::a::low;\npub struct Mid(low::Low);\n");
        let found = circles_of(&[lib, a[0], a[1], high, b, ("unused.rs", "")]);
        assert_eq!(found, ["a -> b.rs by a/high.rs:2 Mid", "b.rs -> a by b.rs:2 low::Low"]);
    }

    #[test]
    fn tests_declarations_reexports_and_lifetimes_close_none() {
        let lib = ("lib.rs", "mod a;\nmod b;\npub use b::Second;\n#[cfg(test)]\nmod tests { use super::b::Second; }\n");
        let a = ("a.rs", "pub struct First;\n#[cfg(test)]\nmod tests {\n    use crate::Second;\n}\n");
        let b = (
            "b.rs",
            "use crate::a::First;\npub struct Second(First);\npub fn number() -> usize {\n    let second = 2;\n    second\n}\n",
        );
        assert_eq!(circles_of(&[lib, a, b]), [""; 0]);
        // A lifetime before a name defines nothing.
        let rows =
            ("rows/mod.rs", "mod one;\nuse crate::row::Row;\npub fn all() -> &'static Row {\n    &one::ROW\n}\n");
        let one = ("rows/one.rs", "use super::*;\npub static ROW: Row = Row;\n");
        assert_eq!(
            circles_of(&[("lib.rs", "mod row;\nmod rows;\n"), ("row.rs", "pub struct Row;\n"), rows, one]),
            [""; 0]
        );
    }
}
