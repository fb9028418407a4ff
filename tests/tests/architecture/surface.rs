//! What a crate makes public, as its sources say: one line an item, its path and its kind. Items under `#[doc(hidden)]` are left
//! out. The lists are kept in `docs/api`, so that a change of them is seen; `cargo xtask api` writes them anew.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;

use proc_macro2::{TokenStream, TokenTree};

use crate::imports::{end_of_item, is_punct, is_test_attribute, word};
use crate::{ORDERED, module_file, read, root};

/// Kinds of items, by the word that begins them.
const KINDS: [&str; 9] = ["mod", "struct", "enum", "union", "trait", "type", "fn", "const", "static"];

/// Walks the public modules of a crate.
struct Walk {
    source: PathBuf,
    lines: BTreeSet<String>,
}

impl Walk {
    fn module(&mut self, tokens: TokenStream, module: &[String]) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let (mut at, mut hidden) = (0, false);
        while at < tokens.len() {
            let rest = &tokens[at..];
            if let [mark, inner, TokenTree::Group(_), ..] = rest
                && is_punct(mark, '#')
                && is_punct(inner, '!')
            {
                at += 3;
            } else if is_test_attribute(rest) {
                at = end_of_item(&tokens, at + 2);
            } else if let [mark, TokenTree::Group(attribute), ..] = rest
                && is_punct(mark, '#')
            {
                let text = attribute.stream().to_string().replace(' ', "");
                hidden |= text == "doc(hidden)";
                // An exported macro stands at the crate's root, wherever it is written.
                if let ("macro_export", Some(name)) = (text.as_str(), word(tokens.get(at + 4))) {
                    self.lines.insert(format!("{name} macro"));
                }
                at += 2;
            } else {
                let is_public = word(rest.first()).as_deref() == Some("pub");
                // `pub(crate)` and the like are no one's business.
                let restricted = matches!(rest.get(1), Some(TokenTree::Group(_)));
                if is_public && !restricted && !hidden {
                    self.item(&rest[1..], module);
                }
                at = end_of_item(&tokens, at);
                hidden = false;
            }
        }
    }

    /// An item behind its `pub`.
    fn item(&mut self, tokens: &[TokenTree], module: &[String]) {
        let words: Vec<String> = tokens.iter().map_while(|token| word(Some(token))).collect();
        let path = |name: &str| [module, &[name.to_owned()]].concat();
        if words.first().is_some_and(|word| word == "use") {
            let end = tokens.iter().position(|token| is_punct(token, ';')).unwrap_or(tokens.len());
            for name in used(&tokens[1..end]) {
                self.lines.insert(format!("{} use", path(&name).join("::")));
            }
            return;
        }
        // The last that fits: `const fn f` is a function.
        let Some(kind) = words.iter().rposition(|word| KINDS.contains(&word.as_str())) else { return };
        let Some(name) = words.get(kind + 1) else { return };
        let own = path(name);
        self.lines.insert(format!("{} {}", own.join("::"), words[kind]));
        if words[kind] == "mod" {
            let body = match tokens.get(kind + 2) {
                Some(TokenTree::Group(body)) => body.stream(),
                _ => read(&module_file(&self.source, &own)).parse().expect("a source file"),
            };
            self.module(body, &own);
        }
    }
}

/// The names that the tree of a `use` brings.
fn used(tokens: &[TokenTree]) -> Vec<String> {
    match tokens {
        [.., TokenTree::Group(members)] => {
            let members: Vec<TokenTree> = members.stream().into_iter().collect();
            members.split(|token| is_punct(token, ',')).filter(|one| !one.is_empty()).flat_map(used).collect()
        }
        // `a::{self}` brings a, and no crate here has it.
        [.., last] => vec![last.to_string()],
        [] => Vec::new(),
    }
}

#[test]
fn the_public_surface_is_the_one_that_is_kept() {
    for krate in ORDERED {
        let source = root().join("crates").join(krate).join("src");
        let tokens = read(&source.join("lib.rs")).parse().expect("a source file");
        let mut walk = Walk { source, lines: BTreeSet::new() };
        walk.module(tokens, &[]);
        let found = walk.lines.iter().map(|line| format!("{line}\n")).collect::<String>();
        let path = root().join("docs/api").join(format!("{krate}.txt"));
        if std::env::var("IMF_WRITE_API").is_ok_and(|value| value == "1") {
            fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            fs::write(&path, &found).expect("a list");
        }
        let kept = fs::read_to_string(&path).unwrap_or_default();
        let [found, kept] = [&found, &kept].map(|text| text.lines().collect::<BTreeSet<_>>());
        let (new, gone): (Vec<_>, Vec<_>) =
            (found.difference(&kept).collect(), kept.difference(&found).collect());
        assert!(
            new.is_empty() && gone.is_empty(),
            "{krate} makes public {new:#?} and no longer {gone:#?}; where that is meant, run cargo xtask api"
        );
    }
}

#[test]
fn items_are_named_by_path_and_kind() {
    let text = "//! Of the module.\npub use a::{b::C, D as E, F}; pub(crate) struct No; #[doc(hidden)] pub fn no() {}\n\
                pub mod inside { pub const fn f() {} #[derive(Clone)] pub struct S { pub field: u8 } impl S { pub fn g() {} } }\n\
                #[cfg(test)] pub mod no {} #[macro_export] macro_rules! m { () => {} } pub const X: u8 = { 1 };\n\
                pub static Y: u8 = 2; mod private { pub enum No {} }";
    let mut walk = Walk { source: PathBuf::new(), lines: BTreeSet::new() };
    walk.module(text.parse().expect("tokens"), &[]);
    let expected = [
        "C use",
        "E use",
        "F use",
        "X const",
        "Y static",
        "inside mod",
        "inside::S struct",
        "inside::f fn",
        "m macro",
    ];
    assert_eq!(walk.lines.iter().map(String::as_str).collect::<Vec<_>>(), expected);
}
