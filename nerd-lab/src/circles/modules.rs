//! A module: its names, its imports, and the paths that it uses.

use std::collections::HashMap;
use std::path::PathBuf;

use syn::UseTree;
use syn::spanned::Spanned;

/// What a name in a module means. A name may mean several things: a module and a function, or one thing for each feature.
pub enum Name {
    Module(usize),
    Item,
    Import(Vec<String>),
}

pub struct Used {
    pub path: Vec<String>,
    pub line: usize,
}

/// A module. An inline module has its parent's file.
#[derive(Default)]
pub struct Module {
    pub file: PathBuf,
    pub parent: Option<usize>,
    pub names: HashMap<String, Vec<Name>>,
    pub globs: Vec<Used>,
    pub used: Vec<Used>,
}

impl Module {
    /// Takes the names of a `use` below a path; one that is private is also a use of what it names.
    pub fn import(&mut self, above: &[String], tree: &UseTree, private: bool) {
        let line = tree.span().start().line;
        let below = |name: &syn::Ident| if name == "self" { above.to_vec() } else { [above, &[name.to_string()]].concat() };
        match tree {
            UseTree::Path(part) => self.import(&below(&part.ident), &part.tree, private),
            UseTree::Group(group) => group.items.iter().for_each(|part| self.import(above, part, private)),
            UseTree::Glob(_) => self.globs.push(Used { path: above.into(), line }),
            UseTree::Name(leaf) => self.name(below(&leaf.ident), None, line, private),
            UseTree::Rename(leaf) => self.name(below(&leaf.ident), Some(leaf.rename.to_string()), line, private),
        }
    }

    fn name(&mut self, path: Vec<String>, renamed: Option<String>, line: usize, private: bool) {
        let name = renamed.or_else(|| path.last().cloned()).unwrap_or_default();
        self.names.entry(name).or_default().push(Name::Import(path.clone()));
        self.used.extend(private.then_some(Used { path, line }));
    }
}
