//! The paths that an item uses, also those in macros and attributes.

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};

use super::modules::{Module, Used};

pub struct Paths<'a> {
    module: &'a mut Module,
}

impl<'a> Paths<'a> {
    pub fn of(module: &'a mut Module, item: &syn::Item) {
        Self { module }.visit_item(item);
    }

    /// Paths in text that is not parsed: names joined by `::`, types, and what is called.
    fn scan(&mut self, tokens: TokenStream) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let is = |k: usize, c: char| matches!(tokens.get(k), Some(TokenTree::Punct(p)) if p.as_char() == c);
        let mut k = 0;
        while k < tokens.len() {
            match &tokens[k] {
                TokenTree::Group(group) => self.scan(group.stream()),
                TokenTree::Ident(first) => {
                    let after_dot = k > 0 && is(k - 1, '.');
                    let (mut path, line) = (vec![first.to_string()], first.span().start().line);
                    while is(k + 1, ':') && is(k + 2, ':') {
                        let Some(TokenTree::Ident(next)) = tokens.get(k + 3) else { break };
                        path.push(next.to_string());
                        k += 3;
                    }
                    let called = is(k + 1, '!') || matches!(tokens.get(k + 1), Some(TokenTree::Group(_)));
                    if !after_dot && (path.len() > 1 || called || begins_large(&path[0])) {
                        self.module.used.push(Used { path, line });
                    }
                }
                _ => {}
            }
            k += 1;
        }
    }
}

impl<'ast> Visit<'ast> for Paths<'_> {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.leading_colon.is_none() {
            let line = path.segments.first().map_or(0, |s| s.ident.span().start().line);
            self.module.used.push(Used { path: path.segments.iter().map(|s| s.ident.to_string()).collect(), line });
        }
        visit::visit_path(self, path);
    }

    /// A small name alone is a variable, unless it is called.
    fn visit_expr_path(&mut self, expr: &'ast syn::ExprPath) {
        if expr.path.get_ident().is_none_or(|name| begins_large(&name.to_string())) {
            visit::visit_expr_path(self, expr);
        }
    }

    fn visit_expr_call(&mut self, call: &'ast syn::ExprCall) {
        if let syn::Expr::Path(function) = &*call.func {
            self.visit_path(&function.path);
        }
        visit::visit_expr_call(self, call);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.visit_path(&call.path);
        self.scan(call.tokens.clone());
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        if let syn::Meta::List(list) = &attribute.meta {
            self.scan(list.tokens.clone());
        }
    }

    fn visit_item_use(&mut self, import: &'ast syn::ItemUse) {
        self.module.import(&[], &import.tree, true);
    }
}

fn begins_large(name: &str) -> bool {
    name.starts_with(char::is_uppercase)
}
