//! How long files are, how many lie in a folder, what they may be called, and that each lies where its module is.

use super::tokens::tokens;
use super::tokens::Token::{Sign, Word};
use super::{read, tracked_files};
use std::collections::BTreeMap;

const LINES_OF_A_FILE: usize = 500;
const FILES_OF_A_FOLDER: usize = 15;
const LINES_OF_THE_README: usize = 150;

/// Folders of data, however many files they hold.
const DATA: [&str; 3] = ["fixtures", "corpus", "vectors"];

/// Names that state nothing about what is in a file.
const EMPTY_NAMES: [&str; 11] = [
    "words",
    "story",
    "place",
    "view",
    "own_files",
    "asked_witnesses",
    "recall",
    "utils",
    "common",
    "helpers",
    "manager",
];

fn is_rust(path: &&String) -> bool {
    path.ends_with(".rs")
}

/// Whether a text has more lines than it may, in words.
fn too_long(path: &str, text: &str, limit: usize) -> Option<String> {
    let lines = text.lines().count();
    (lines > limit).then(|| format!("{path} has {lines} lines; at most {limit} are allowed"))
}

/// Folders of sources or tests that hold too many files.
fn crowded(paths: &[String]) -> Vec<String> {
    let mut folders = BTreeMap::<_, (usize, bool)>::new();
    for path in paths {
        let (folder, name) = path.rsplit_once('/').unwrap_or((".", path));
        let held = folders.entry(folder).or_default();
        held.0 += 1;
        held.1 |= name.ends_with(".rs");
    }
    folders
        .into_iter()
        .filter(|(folder, (files, has_source))| {
            let data = folder.split('/').any(|name| DATA.contains(&name));
            *files > FILES_OF_A_FOLDER && *has_source && !data
        })
        .map(|(folder, (files, _))| {
            format!("{folder} holds {files} files; at most {FILES_OF_A_FOLDER} are allowed")
        })
        .collect()
}

/// A file, or a folder of sources, whose name states nothing.
fn empty_name(path: &str) -> Option<&str> {
    path.trim_end_matches(".rs")
        .split('/')
        .find(|name| EMPTY_NAMES.contains(name))
}

/// Whether a source takes a module from elsewhere, by `#[path = "…"]`. Each crate that does compiles the module again: what several need is in
/// the crate `testkit`.
fn takes_a_module_from_elsewhere(text: &str) -> bool {
    let path = [Sign('['), Word("path"), Sign('=')];
    tokens(text).windows(3).any(|three| three == path)
}

#[test]
fn modules_lie_where_they_are_declared() {
    let paths = tracked_files();
    let wrong: Vec<_> = paths
        .iter()
        .filter(is_rust)
        .filter(|path| takes_a_module_from_elsewhere(&read(path)))
        .collect();
    assert!(
        wrong.is_empty(),
        "{wrong:?} have #[path]: move what they take into testkit/, or below them"
    );
}

#[test]
fn a_module_from_elsewhere_is_seen() {
    assert!(takes_a_module_from_elsewhere(
        "#[path = \"../other/mod.rs\"] mod other;"
    ));
    assert!(!takes_a_module_from_elsewhere(
        "mod path; // #[path = \"x.rs\"]\nlet [path] = \"[path =\";"
    ));
}

#[test]
fn files_are_short() {
    let paths = tracked_files();
    let long: Vec<_> = paths
        .iter()
        .filter(is_rust)
        .filter_map(|path| too_long(path, &read(path), LINES_OF_A_FILE))
        .collect();
    assert!(long.is_empty(), "{}", long.join("\n"));
}

#[test]
fn the_readme_is_short() {
    let long = too_long("README.md", &read("README.md"), LINES_OF_THE_README);
    assert_eq!(long, None);
}

#[test]
fn folders_hold_few_files() {
    let crowded = crowded(&tracked_files());
    assert!(crowded.is_empty(), "{}", crowded.join("\n"));
}

#[test]
fn names_say_what_is_in_a_file() {
    let paths = tracked_files();
    let empty: Vec<_> = paths
        .iter()
        .filter(is_rust)
        .filter(|path| empty_name(path).is_some())
        .collect();
    assert!(empty.is_empty(), "{empty:?} need names that state more");
}

#[test]
fn a_line_too_many_is_seen() {
    assert_eq!(too_long("a.rs", &"\n".repeat(500), 500), None);
    assert_eq!(
        too_long("a.rs", &"\n".repeat(501), 500).unwrap(),
        "a.rs has 501 lines; at most 500 are allowed"
    );
}

#[test]
fn a_file_too_many_is_seen_where_it_is_no_data() {
    let sixteen = |folder: &str| -> Vec<String> {
        (0..16)
            .map(|number| format!("{folder}/{number}.rs"))
            .collect()
    };
    assert_eq!(
        crowded(&sixteen("ledger/tests")),
        ["ledger/tests holds 16 files; at most 15 are allowed"]
    );
    assert_eq!(crowded(&sixteen("ledger/tests")[1..]), [""; 0]);
    assert_eq!(crowded(&sixteen("tests/corpus/ledger/rules")), [""; 0]);
}

#[test]
fn an_empty_name_is_seen_wherever_it_stands() {
    assert_eq!(empty_name("cli/src/audit/words.rs"), Some("words"));
    assert_eq!(empty_name("cli/tests/common/mod.rs"), Some("common"));
    assert_eq!(empty_name("cli/src/audit/wording.rs"), None);
}
