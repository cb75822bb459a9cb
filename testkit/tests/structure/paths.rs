//! The modules that a source file names: in `use`, and in paths such as `crate::rules::apply`.

use super::tokens::tokens;
use super::tokens::Token::{self, Colons, Sign, Word};
use std::collections::{BTreeMap, BTreeSet};

/// Names from the root of the crate: `["rules", "apply"]` for `crate::rules::apply`.
pub type Path = Vec<String>;

/// What a source file states about other files.
pub struct Source {
    /// Every path into the crate that the file names.
    pub named: BTreeSet<Path>,
    /// What its `use` declarations import from the crate, by the name that each thing has here.
    pub imports: BTreeMap<String, Path>,
    /// Whether it only declares modules and imports names.
    pub only_declares: bool,
}

/// Reads the file that is module `here`; `modules` are all modules of the crate that have a file.
pub fn source(here: &[String], text: &str, modules: &BTreeSet<Path>) -> Source {
    let tokens = without_tests(&tokens(text));
    let mut imports = BTreeMap::new();
    let mut named = BTreeSet::new();
    let mut inline = Vec::new();
    let mut at = 0;
    // The imports are collected first, because a path may begin with an imported name that is imported below it.
    while at < tokens.len() {
        let module = inside(here, &inline);
        if tokens[at] == Word("use") && tokens.get(at + 1) != Some(&Sign('<')) {
            let mut leaves = Vec::new();
            at = use_tree(&tokens, at + 1, Vec::new(), &mut leaves);
            for (path, name) in leaves {
                if let Some(path) = absolute(&path, &module, modules, &BTreeMap::new()) {
                    named.insert(path.clone());
                    imports.insert(name, path);
                }
            }
        }
        at = step(&tokens, at, &mut inline);
    }
    (at, inline) = (0, Vec::new());
    while at < tokens.len() {
        let begins = at == 0 || !matches!(tokens[at - 1], Colons | Sign('.') | Word("in"));
        match (tokens[at], tokens.get(at + 1)) {
            (Word("use"), Some(after)) if *after != Sign('<') => {
                let end = tokens[at..].iter().position(|token| *token == Sign(';'));
                at += end.unwrap_or(0);
            }
            (Word(_), Some(Colons)) if begins => {
                let path = path_from(&tokens, at);
                let module = inside(here, &inline);
                named.extend(absolute(&path, &module, modules, &imports));
            }
            _ => (),
        }
        at = step(&tokens, at, &mut inline);
    }
    Source {
        named,
        imports,
        only_declares: only_declares(&tokens),
    }
}

/// The module that the innermost braces belong to.
fn inside(here: &[String], inline: &[Option<&str>]) -> Path {
    let inner = inline.iter().flatten().map(|name| name.to_string());
    here.iter().cloned().chain(inner).collect()
}

/// Goes on to the next token, and keeps account of braces: of those of `mod name { … }` by that name.
fn step<'a>(tokens: &[Token<'a>], at: usize, inline: &mut Vec<Option<&'a str>>) -> usize {
    match tokens.get(at) {
        Some(Sign('{')) => inline.push(match tokens[..at] {
            [.., Word("mod"), Word(name)] => Some(name),
            _ => None,
        }),
        Some(Sign('}')) => {
            inline.pop();
        }
        _ => (),
    }
    at + 1
}

/// The names joined by `::` that begin at a token.
fn path_from<'a>(tokens: &[Token<'a>], mut at: usize) -> Vec<&'a str> {
    let mut path = Vec::new();
    while let Some(Word(name)) = tokens.get(at) {
        path.push(*name);
        if tokens.get(at + 1) != Some(&Colons) {
            break;
        }
        at += 2;
    }
    path
}

/// Collects the paths of a `use` tree and the names that they get here. Returns where the tree ends.
fn use_tree<'a>(
    tokens: &[Token<'a>],
    mut at: usize,
    mut path: Vec<&'a str>,
    leaves: &mut Vec<(Vec<&'a str>, String)>,
) -> usize {
    loop {
        match tokens.get(at) {
            Some(Word("as")) => {
                if let Some(Word(name)) = tokens.get(at + 1) {
                    leaves.push((path, name.to_string()));
                }
                return at + 2;
            }
            Some(Word(name)) => path.push(name),
            Some(Colons) => (),
            Some(Sign('*')) => path.push("*"),
            Some(Sign('{')) => {
                at += 1;
                while !matches!(tokens.get(at), None | Some(Sign('}'))) {
                    at = use_tree(tokens, at, path.clone(), leaves);
                    if tokens.get(at) == Some(&Sign(',')) {
                        at += 1;
                    }
                }
                return at + 1;
            }
            _ => {
                // `a::{self}` imports `a`. A single `self` is this module.
                if path.len() > 1 && matches!(path.last(), Some(&"self" | &"*")) {
                    path.pop();
                }
                let name = path.last().copied().unwrap_or_default().to_string();
                leaves.push((path, name));
                return at;
            }
        }
        at += 1;
    }
}

/// The path from the crate's root; none for a path into another crate.
fn absolute(
    path: &[&str],
    module: &[String],
    modules: &BTreeSet<Path>,
    imports: &BTreeMap<String, Path>,
) -> Option<Path> {
    let (first, mut rest) = path.split_first()?;
    let mut base = match *first {
        "crate" => Path::new(),
        "self" => module.to_vec(),
        "super" => module[..module.len().saturating_sub(1)].to_vec(),
        name => {
            let child = [module, &[name.to_string()]].concat();
            match imports.get(name) {
                Some(imported) => imported.clone(),
                None if modules.contains(&child) => child,
                None => return None,
            }
        }
    };
    while let Some((&"super", after)) = rest.split_first() {
        base.pop();
        rest = after;
    }
    base.extend(rest.iter().map(|name| name.to_string()));
    Some(base)
}

/// Leaves out every item under `#[cfg(test)]`.
fn without_tests<'a>(tokens: &[Token<'a>]) -> Vec<Token<'a>> {
    const TEST: [Token; 7] = [
        Sign('#'),
        Sign('['),
        Word("cfg"),
        Sign('('),
        Word("test"),
        Sign(')'),
        Sign(']'),
    ];
    const ITEMS: [&str; 6] = ["mod", "use", "fn", "impl", "pub", "const"];
    let mut kept = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let item = tokens.get(at + TEST.len());
        let is_item = matches!(item, Some(Word(word)) if ITEMS.contains(word));
        if !is_item || !tokens[at..].starts_with(&TEST) {
            kept.push(tokens[at]);
            at += 1;
            continue;
        }
        let mut depth = 0;
        loop {
            match tokens.get(at) {
                Some(Sign('{')) => depth += 1,
                Some(Sign('}')) => depth -= 1,
                _ => (),
            }
            let ends = matches!(tokens.get(at), None | Some(Sign('}' | ';')));
            at += 1;
            if ends && depth == 0 {
                break;
            }
        }
    }
    kept
}

/// Whether a file holds declarations of modules and imports, and nothing else.
fn only_declares(mut tokens: &[Token]) -> bool {
    let after = |tokens: &[Token], last: Token| tokens.iter().position(|t| *t == last);
    loop {
        let end = match tokens {
            [] => return true,
            [Sign('#'), ..] => after(tokens, Sign(']')),
            [Word("pub"), Sign('('), ..] => after(tokens, Sign(')')),
            [Word("pub"), ..] => Some(0),
            [Word("use"), ..] => after(tokens, Sign(';')),
            [Word("mod"), Word(_), Sign(';'), ..] => Some(2),
            _ => return false,
        };
        match end {
            Some(end) => tokens = &tokens[end + 1..],
            None => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(text: &str) -> Path {
        text.split("::")
            .filter(|name| !name.is_empty())
            .map(str::to_owned)
            .collect()
    }

    fn read(here: &str, text: &str) -> Source {
        let modules = ["", "a", "a::b", "a::c", "d"].into_iter().map(path);
        source(&path(here), text, &modules.collect())
    }

    fn named(here: &str, text: &str) -> Vec<String> {
        let source = read(here, text);
        source.named.iter().map(|path| path.join("::")).collect()
    }

    #[test]
    fn use_trees_are_followed_to_their_leaves() {
        let text = "use crate::{a::{self, b::{One, Two as Three}}, d::*}; use std::fs;";
        assert_eq!(named("d", text), ["a", "a::b::One", "a::b::Two", "d"]);
        let source = read("d", text);
        assert_eq!(source.imports["Three"], path("a::b::Two"));
        assert_eq!(source.imports["a"], path("a"));
    }

    #[test]
    fn paths_begin_at_the_root_here_above_or_at_a_child() {
        assert_eq!(named("a::b", "fn f() { crate::d::g::<T>(); }"), ["d::g"]);
        assert_eq!(named("a::b", "use super::super::d::X;"), ["d::X"]);
        assert_eq!(named("a::b", "type T = super::c::X;"), ["a::c::X"]);
        assert_eq!(
            named("a", "use self::b::X; use c::Y;"),
            ["a::b::X", "a::c::Y"]
        );
        assert_eq!(
            named("a", "fn f() { b::g(); x.d::<T>(); e::d::g() }"),
            ["a::b::g"]
        );
        assert_eq!(named("d", "b::g()"), [""; 0]);
        assert_eq!(named("d", "b::g(); use crate::a::b;"), ["a::b", "a::b::g"]);
    }

    #[test]
    fn a_module_inside_a_file_has_its_own_super() {
        let text = "mod x { use super::b::X; } fn f() { super::d::g() }";
        assert_eq!(named("a", text), ["a::b::X", "d::g"]);
    }

    #[test]
    fn tests_comments_and_visibility_name_nothing() {
        let text = "#[cfg(test)] mod tests { use crate::d::X; } #[cfg(test)] use crate::d::Y;
            // crate::d::Z
            pub(in crate::a) fn f() {}";
        assert_eq!(named("a::b", text), [""; 0]);
    }

    #[test]
    fn a_file_that_only_declares_is_told_from_one_that_does_more() {
        let text = "#![no_std] #[cfg(x)] pub mod a; pub(crate) mod d; pub use a::{b, c};";
        assert!(read("", text).only_declares);
        assert!(!read("", &format!("{text} pub const X: u8 = 1;")).only_declares);
    }
}
