//! What a source file names of its own crate: every path that starts with `crate`, `super`, `self` or a module
//! declared above in the file, in `use` lines and in the middle of code. Comments and strings are not tokens, and
//! items under `#[cfg(test)]` are passed over.

use proc_macro2::{Delimiter, LexError, TokenStream, TokenTree};

/// A path from the crate's root, and where it stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Import {
    pub(crate) path: Vec<String>,
    pub(crate) line: usize,
}

/// One source file.
#[derive(Debug, Default)]
pub(crate) struct Source {
    pub(crate) imports: Vec<Import>,
    /// Modules declared as `mod name;`, by their paths.
    pub(crate) children: Vec<Vec<String>>,
    /// Names of modules written out as `mod name { … }`.
    pub(crate) inline_modules: Vec<String>,
}

/// Reads the file of `module`, a path from the crate's root.
pub(crate) fn parse(text: &str, module: &[String]) -> Result<Source, LexError> {
    let mut source = Source::default();
    source.scan(text.parse()?, module);
    Ok(source)
}

impl Source {
    fn scan(&mut self, tokens: TokenStream, module: &[String]) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let mut at = 0;
        while at < tokens.len() {
            if is_test_attribute(&tokens[at..]) {
                at = end_of_item(&tokens, at + 2);
                continue;
            }
            if let (Some("mod"), Some(name)) = (word(tokens.get(at)).as_deref(), word(tokens.get(at + 1))) {
                let mut path = module.to_vec();
                path.push(name.clone());
                match tokens.get(at + 2) {
                    Some(TokenTree::Group(body)) => {
                        self.inline_modules.push(name);
                        self.scan(body.stream(), &path);
                        at += 3;
                        continue;
                    }
                    _ => self.children.push(path),
                }
            }
            let base = match word(tokens.get(at)).as_deref() {
                Some("crate") => Some(Vec::new()),
                Some("self") => Some(module.to_vec()),
                Some("super") => Some(module[..module.len().saturating_sub(1)].to_vec()),
                Some(name) if !is_path_separator(&tokens[at.saturating_sub(2)..]) => self.child(module, name),
                _ => None,
            };
            match base {
                Some(base) if is_path_separator(&tokens[at + 1..]) => at = self.path(&tokens, at + 1, base),
                _ => {
                    if let TokenTree::Group(group) = &tokens[at] {
                        self.scan(group.stream(), module);
                    }
                    at += 1;
                }
            }
        }
    }

    /// The path of a module declared above in this file: its name alone reaches it.
    fn child(&self, module: &[String], name: &str) -> Option<Vec<String>> {
        let is_it = |path: &&Vec<String>| {
            path.split_last().is_some_and(|(last, rest)| last == name && rest == module)
        };
        self.children.iter().find(is_it).cloned()
    }

    /// Follows `::name::name` or `::{…}` from `at` and records the paths; gives back where it ends.
    fn path(&mut self, tokens: &[TokenTree], mut at: usize, mut path: Vec<String>) -> usize {
        let line = tokens[at.saturating_sub(1)].span().start().line;
        while is_path_separator(&tokens[at..]) {
            match tokens.get(at + 2) {
                Some(TokenTree::Ident(name)) if name == "super" => {
                    path.pop();
                }
                Some(TokenTree::Ident(name)) => path.push(name.to_string()),
                Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Brace => {
                    self.tree(group.stream(), &path);
                    return at + 3;
                }
                // `*`, or the `<` of a turbofish.
                _ => break,
            }
            at += 3;
        }
        self.imports.push(Import { path, line });
        at
    }

    /// The members of `use path::{…}`.
    fn tree(&mut self, members: TokenStream, base: &[String]) {
        let tokens: Vec<TokenTree> = members.into_iter().collect();
        for member in tokens.split(|token| is_punct(token, ',')) {
            match member.first() {
                Some(TokenTree::Ident(name)) => {
                    let mut path = base.to_vec();
                    if name != "self" {
                        path.push(name.to_string());
                    }
                    self.path(member, 1, path);
                }
                Some(other) => {
                    self.imports.push(Import { path: base.to_vec(), line: other.span().start().line });
                }
                None => {}
            }
        }
    }
}

pub(crate) fn word(token: Option<&TokenTree>) -> Option<String> {
    match token {
        Some(TokenTree::Ident(ident)) => Some(ident.to_string()),
        _ => None,
    }
}

pub(crate) fn is_punct(token: &TokenTree, mark: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == mark)
}

fn is_path_separator(tokens: &[TokenTree]) -> bool {
    matches!(tokens, [one, two, ..] if is_punct(one, ':') && is_punct(two, ':'))
}

/// `#[cfg(test)]`, or a `cfg` of several conditions that needs `test`.
pub(crate) fn is_test_attribute(tokens: &[TokenTree]) -> bool {
    let [mark, TokenTree::Group(attribute), ..] = tokens else { return false };
    let text = attribute.stream().to_string().replace(' ', "");
    is_punct(mark, '#') && (text == "cfg(test)" || text.starts_with("cfg(all(test"))
}

/// Behind the item that starts at `at`: behind its first braces or semicolon; `use a::{b};` ends at its semicolon.
pub(crate) fn end_of_item(tokens: &[TokenTree], at: usize) -> usize {
    let ends = |token: &TokenTree| match token {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        _ => is_punct(token, ';'),
    };
    match tokens[at..].iter().position(ends) {
        Some(end) => {
            at + end + 1 + usize::from(tokens.get(at + end + 1).is_some_and(|next| is_punct(next, ';')))
        }
        None => tokens.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(text: &str) -> Vec<String> {
        text.split("::").map(str::to_owned).collect()
    }

    fn imports(text: &str) -> Vec<(String, usize)> {
        let source = parse(text, &path("siren::reference")).unwrap();
        source.imports.into_iter().map(|import| (import.path.join("::"), import.line)).collect()
    }

    #[test]
    fn paths_are_found_wherever_they_stand() {
        let text = "use crate::grid::Grid;\nuse crate::{mesh, training::{Loss, AdamConfig as A}};\n\
                    pub(crate) fn f() -> crate::tool::Tool { assert!(super::shape() > crate::unit::MM) }\n\
                    use super::super::samples::*;\nuse self::inner::x;\n";
        let expected = [
            ("grid::Grid", 1),
            ("mesh", 2),
            ("training::Loss", 2),
            ("training::AdamConfig", 2),
            ("tool::Tool", 3),
            ("siren::shape", 3),
            ("unit::MM", 3),
            ("samples", 4),
            ("siren::reference::inner::x", 5),
        ];
        let found = imports(text);
        let found: Vec<(&str, usize)> = found.iter().map(|(path, line)| (path.as_str(), *line)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_child_is_reached_by_its_name_alone() {
        let text = "mod inner;\npub use inner::x;\nfn f() { other::inner::y(); let inner = 1; }\n";
        assert_eq!(imports(text), [("siren::reference::inner::x".to_owned(), 2)]);
    }

    #[test]
    fn comments_strings_and_tests_are_passed_over() {
        let text = "/// [`crate::later`]\n// crate::later::x\nconst S: &str = \"crate::later\";\n\
                    #[cfg(test)]\nuse crate::later::{x};\n#[cfg(test)]\n#[allow(unused)]\n\
                    mod tests { use crate::later::x; }\n#[cfg(all(test, unix))]\nmod more;\nuse crate::grid::y;\n";
        assert_eq!(imports(text), [("grid::y".to_owned(), 11)]);
    }

    #[test]
    fn modules_are_told_apart_by_where_their_body_is() {
        let source = parse("pub mod one; mod two { mod three; use super::x; }", &path("a")).unwrap();
        assert_eq!(source.children, [path("a::one"), path("a::two::three")]);
        assert_eq!(source.inline_modules, ["two"]);
        assert_eq!(source.imports[0].path, path("a::x"));
    }
}
