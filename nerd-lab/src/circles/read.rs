//! A crate's modules as its sources declare them: their names, their imports, and the paths that they use, also those in macros and
//! attributes.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use proc_macro2::{TokenStream, TokenTree};
use quote::ToTokens;
use syn::spanned::Spanned;
use syn::{Attribute, Item, ItemUse, UseTree, Visibility};

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

/// All modules below `src/lib.rs` or `src/main.rs`, which is the first. Tests are left out, features are not.
pub fn read(root: &Path) -> Result<Vec<Module>> {
    let mut modules = Vec::new();
    file(&mut modules, root, None, root.parent().unwrap_or(Path::new("")))?;
    Ok(modules)
}

/// Reads one file as a module; `folder` has its children.
fn file(modules: &mut Vec<Module>, path: &Path, parent: Option<usize>, folder: &Path) -> Result<usize> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let parsed = syn::parse_file(&text).with_context(|| format!("cannot parse {}", path.display()))?;
    module(modules, path, parent, folder, &parsed.items)
}

fn module(modules: &mut Vec<Module>, path: &Path, parent: Option<usize>, folder: &Path, items: &[Item]) -> Result<usize> {
    let id = modules.len();
    modules.push(Module { file: path.into(), parent, ..Default::default() });
    for item in items {
        if attributes(item).iter().any(of_tests) {
            continue;
        }
        if let Item::Mod(child) = item {
            let name = child.ident.to_string();
            let below = match &child.content {
                Some((_, items)) => module(modules, path, Some(id), &folder.join(&name), items)?,
                None => {
                    let candidates = [folder.join(format!("{name}.rs")), folder.join(&name).join("mod.rs")];
                    let source = candidates.into_iter().find(|c| c.is_file()).unwrap_or_default();
                    let plain = source.file_name().is_none_or(|f| f != "mod.rs");
                    let folder = if plain { source.with_extension("") } else { source.with_file_name("") };
                    file(modules, &source, Some(id), &folder).with_context(|| format!("mod {name} in {}", path.display()))?
                }
            };
            modules[id].names.entry(name).or_default().push(Name::Module(below));
            continue;
        }
        if let Some(name) = defined(item) {
            modules[id].names.entry(name).or_default().push(Name::Item);
        }
        match item {
            Item::Use(import) => modules[id].import(&[], &import.tree, matches!(import.vis, Visibility::Inherited)),
            _ => modules[id].scan(item.to_token_stream()),
        }
    }
    Ok(id)
}

impl Module {
    /// Takes the names of a `use` below a path; one that is private is also a use of what it names.
    fn import(&mut self, above: &[String], tree: &UseTree, private: bool) {
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

    /// Paths in an item's text: names joined by `::`, types, what is called, and what is imported within. A small name alone is a
    /// variable, unless it is called; what follows a dot or two colons is part of something else.
    fn scan(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let is = |k: usize, c: char| matches!(tokens.get(k), Some(TokenTree::Punct(p)) if p.as_char() == c);
        let group = |k: usize| matches!(tokens.get(k), Some(TokenTree::Group(_)));
        let mut k = 0;
        while k < tokens.len() {
            match &tokens[k] {
                TokenTree::Group(group) => self.scan(group.stream()),
                TokenTree::Ident(first) if first == "use" => {
                    let end = (k..tokens.len()).find(|k| is(*k, ';')).map_or(tokens.len(), |end| end + 1);
                    if let Ok(import) = syn::parse2::<ItemUse>(tokens[k..end].iter().cloned().collect()) {
                        self.import(&[], &import.tree, true);
                        k = end - 1;
                    }
                }
                TokenTree::Ident(first) => {
                    let inside = k > 0 && (is(k - 1, '.') || is(k - 1, ':') && k > 1 && is(k - 2, ':'));
                    let (mut path, line) = (vec![first.to_string()], first.span().start().line);
                    while is(k + 1, ':') && is(k + 2, ':') {
                        let Some(TokenTree::Ident(next)) = tokens.get(k + 3) else { break };
                        path.push(next.to_string());
                        k += 3;
                    }
                    let called = is(k + 1, '!') && group(k + 2) || group(k + 1);
                    if !inside && (path.len() > 1 || called || path[0].starts_with(char::is_uppercase)) {
                        self.used.push(Used { path, line });
                    }
                }
                _ => {}
            }
            k += 1;
        }
    }
}

fn of_tests(attribute: &Attribute) -> bool {
    match &attribute.meta {
        syn::Meta::Path(path) => path.is_ident("test"),
        syn::Meta::List(list) if list.path.is_ident("cfg") => {
            let condition = list.tokens.to_string();
            condition.split(|c: char| !c.is_alphanumeric()).any(|word| word == "test") && !condition.contains("not")
        }
        _ => false,
    }
}

/// Of items that may be for tests alone.
fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(i) => &i.attrs,
        Item::Fn(i) => &i.attrs,
        Item::Impl(i) => &i.attrs,
        Item::Mod(i) => &i.attrs,
        Item::Use(i) => &i.attrs,
        _ => &[],
    }
}

fn defined(item: &Item) -> Option<String> {
    let ident = match item {
        Item::Const(i) => &i.ident,
        Item::Enum(i) => &i.ident,
        Item::Fn(i) => &i.sig.ident,
        Item::Macro(i) => i.ident.as_ref()?,
        Item::Static(i) => &i.ident,
        Item::Struct(i) => &i.ident,
        Item::Trait(i) => &i.ident,
        Item::TraitAlias(i) => &i.ident,
        Item::Type(i) => &i.ident,
        Item::Union(i) => &i.ident,
        _ => return None,
    };
    Some(ident.to_string())
}
