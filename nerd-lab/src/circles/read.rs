//! A crate's modules as its sources declare them.

use std::path::Path;

use anyhow::{Context, Result};
use syn::{Attribute, Item, Visibility};

use super::modules::{Module, Name};
use super::paths::Paths;

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
        if let Item::Use(import) = item {
            modules[id].import(&[], &import.tree, matches!(import.vis, Visibility::Inherited));
            continue;
        }
        Paths::of(&mut modules[id], item);
    }
    Ok(id)
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
