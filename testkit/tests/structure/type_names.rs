//! A type's name states one thing: no two files declare the same one, but for a list that only shrinks.

use super::tokens::{tokens, Token};
use super::{read, tracked_files};
use std::collections::{BTreeMap, BTreeSet};

/// Names that two files declare because both uses are the standard word.
///
/// - `Result`: every crate's own result.
/// - `Sample`: what a model sees, and a picture in an MP4.
/// - `Sha256`: the hash function where SP1's precompile computes it, and elsewhere.
const STANDARD_WORDS: [&str; 3] = ["Result", "Sample", "Sha256"];

/// The names of the types that a file declares outside of its functions and inner modules.
fn declared(text: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut depth = 0_usize;
    for pair in tokens(text).windows(2) {
        match pair {
            [Token::Sign('{' | '(' | '['), _] => depth += 1,
            [Token::Sign('}' | ')' | ']'), _] => depth = depth.saturating_sub(1),
            [Token::Word("struct" | "enum" | "trait" | "type" | "union"), Token::Word(name)]
                if depth == 0 =>
            {
                names.insert((*name).to_owned());
            }
            _ => (),
        }
    }
    names
}

/// The names that several files declare, with these files.
fn declared_twice<'a>(
    files: impl Iterator<Item = (&'a str, String)>,
) -> BTreeMap<String, Vec<&'a str>> {
    let mut all: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for (path, text) in files {
        for name in declared(&text) {
            all.entry(name).or_default().push(path);
        }
    }
    all.retain(|_, files| files.len() > 1);
    all
}

#[test]
fn no_two_files_declare_a_type_of_the_same_name() {
    let tracked = tracked_files();
    let sources = tracked
        .iter()
        .filter(|path| path.ends_with(".rs") && path.contains("/src/"))
        .map(|path| (path.as_str(), read(path)));
    let twice = declared_twice(sources);
    let listed = BTreeSet::from(STANDARD_WORDS);

    let wrong: Vec<_> = twice
        .iter()
        .filter(|(name, _)| !listed.contains(name.as_str()))
        .collect();
    assert!(wrong.is_empty(), "rename all but one of each: {wrong:#?}");
    let gone: Vec<_> = listed
        .iter()
        .filter(|name| !twice.contains_key(**name))
        .collect();
    assert!(
        gone.is_empty(),
        "take {gone:?} off the list: at most one file declares each"
    );
}

#[test]
fn types_are_found_where_a_file_declares_them() {
    let text = "pub(crate) struct A<'a>(&'a [u8; { 1 }]);\n\
        // struct B;\n\
        enum C { D(E) }\n\
        impl F for A<'_> { type G = H; }\n\
        fn f() { struct I; }\n\
        mod tests { union J { k: u8 } }\n\
        pub type L = M; unsafe trait N { type O; }\n\
        union P { q: u8 }\n\
        const R: &str = \"struct S;\";";
    let names: Vec<_> = declared(text).into_iter().collect();
    assert_eq!(names, ["A", "C", "L", "N", "P"]);
}

#[test]
fn a_name_that_two_files_declare_is_found() {
    let files = [
        ("a.rs", "struct X; struct Y;"),
        ("b.rs", "enum X {}"),
        ("c.rs", "mod x { type Y = u8; }"),
    ];
    let twice = declared_twice(files.iter().map(|(path, text)| (*path, (*text).to_owned())));
    assert_eq!(
        twice.into_iter().collect::<Vec<_>>(),
        [("X".to_owned(), vec!["a.rs", "b.rs"])]
    );
}
