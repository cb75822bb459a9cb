//! The files of a crate use one another in no circle. A file that only declares modules and imports names uses nothing:
//! what others take through it is counted as taken from where it comes.

use super::paths::{self, Path, Source};
use super::{read, tracked_files};
use std::collections::{BTreeMap, BTreeSet};

/// The files of one crate: their texts by their paths below the folder of its root.
type Files = BTreeMap<String, String>;
type Edges = BTreeMap<Path, BTreeSet<Path>>;

/// Returns the module that a file is.
fn module(file: &str) -> Path {
    let mut names: Path = file
        .trim_end_matches(".rs")
        .split('/')
        .map(str::to_owned)
        .collect();
    match names.last().map(String::as_str) {
        Some("mod") => drop(names.pop()),
        Some("lib" | "main") if names.len() == 1 => names.clear(),
        _ => (),
    }
    names
}

/// Which file uses which.
fn edges(files: &Files) -> Edges {
    let modules: BTreeSet<_> = files.keys().map(|file| module(file)).collect();
    let sources: BTreeMap<_, _> = files
        .iter()
        .map(|(file, text)| {
            let here = module(file);
            let source = paths::source(&here, text, &modules);
            (here, source)
        })
        .collect();
    let used = |here: &Path, source: &Source| -> BTreeSet<Path> {
        if source.only_declares {
            return BTreeSet::new();
        }
        let uses = source.named.iter().map(|path| file_of(path, &sources, 8));
        uses.filter(|file| file != here).collect()
    };
    sources
        .iter()
        .map(|(here, source)| (here.clone(), used(here, source)))
        .collect()
}

/// Returns the module that holds what a path names, through at most this many imports.
fn file_of(path: &[String], sources: &BTreeMap<Path, Source>, imports: usize) -> Path {
    let length = (0..=path.len())
        .rev()
        .find(|length| sources.contains_key(&path[..*length]))
        .expect("a crate has a root");
    let (here, rest) = path.split_at(length);
    let imported = rest
        .first()
        .and_then(|name| sources[here].imports.get(name));
    match imported {
        Some(imported) if imports > 0 => {
            let whole = [imported, &rest[1..]].concat();
            file_of(&whole, sources, imports - 1)
        }
        _ => here.to_vec(),
    }
}

/// A circle of files, if there is one: each uses the next, and the last uses the first.
fn circle(edges: &Edges) -> Option<Vec<String>> {
    let mut edges = edges.clone();
    // A file that uses no remaining file is in no circle.
    while let Some(free) = edges
        .iter()
        .find(|(_, used)| used.is_empty())
        .map(|(here, _)| here.clone())
    {
        edges.remove(&free);
        for used in edges.values_mut() {
            used.remove(&free);
        }
    }
    let mut walk = vec![edges.keys().next()?];
    loop {
        let next = edges[*walk.last()?].first()?;
        if let Some(begin) = walk.iter().position(|seen| *seen == next) {
            let name = |path: &&Path| format!("crate::{}", path.join("::"));
            return Some(walk[begin..].iter().map(name).collect());
        }
        walk.push(next);
    }
}

/// The crates of the tree by the folder of their sources.
fn crates() -> BTreeMap<String, Files> {
    let tracked = tracked_files();
    let ours: Vec<_> = tracked
        .iter()
        .filter(|path| path.ends_with(".rs"))
        .collect();
    let mut crates = BTreeMap::new();
    for root in &ours {
        let Some((folder, "lib.rs" | "main.rs")) = root.rsplit_once('/') else {
            continue;
        };
        if !folder.ends_with("/src") {
            continue;
        }
        let below = format!("{folder}/");
        let has_library = ours.contains(&&format!("{below}lib.rs"));
        let files = ours
            .iter()
            .filter_map(|path| Some((path.strip_prefix(&below)?, path)))
            .filter(|(file, _)| !(has_library && *file == "main.rs"))
            .map(|(file, path)| (file.to_owned(), read(path)))
            .collect();
        crates.insert(folder.to_owned(), files);
    }
    crates
}

#[test]
fn no_files_of_a_crate_use_one_another_in_a_circle() {
    let crates = crates();
    assert!(crates.contains_key("circuits/src") && crates.contains_key("cli/src"));
    let circles: Vec<_> = crates
        .iter()
        .filter_map(|(folder, files)| {
            let edges = edges(files);
            Some((folder, circle(&edges)?))
        })
        .map(|(folder, circle)| format!("{folder}: {}", circle.join(" uses ")))
        .collect();
    assert!(circles.is_empty(), "{}", circles.join("\n"));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle_of(files: &[(&str, &str)]) -> Option<Vec<String>> {
        let owned = |(file, text): &(&str, &str)| (file.to_string(), text.to_string());
        circle(&edges(&files.iter().map(owned).collect()))
    }

    #[test]
    fn a_circle_of_three_is_found() {
        let files = [
            ("lib.rs", "mod a; mod b; mod c; mod d;"),
            ("a.rs", "use crate::b::B; pub struct A;"),
            ("b.rs", "pub struct B(super::c::C);"),
            ("c/mod.rs", "use crate::a; pub struct C(a::A);"),
            ("d.rs", "use crate::a::A; fn f() {}"),
        ];
        let found = circle_of(&files).unwrap();
        assert_eq!(found, ["crate::a", "crate::b", "crate::c"]);
        assert_eq!(circle_of(&files[..3]), None);
    }

    #[test]
    fn a_circle_through_names_that_the_root_hands_on_is_found() {
        let files = [
            ("lib.rs", "mod a; mod b; pub use a::A; pub use b::B;"),
            ("a.rs", "use crate::B; pub struct A;"),
            ("b.rs", "use crate::A; pub struct B;"),
        ];
        assert_eq!(circle_of(&files).unwrap(), ["crate::a", "crate::b"]);
        assert_eq!(circle_of(&files[..2]), None);
    }

    #[test]
    fn a_parent_that_works_makes_a_circle_and_one_that_declares_none() {
        let child = ("a/b.rs", "use super::X; pub struct B(X);");
        let declaring = ("a/mod.rs", "mod b; pub use b::B; use crate::d::X;");
        let working = ("a/mod.rs", "mod b; pub struct X; fn f() { b::g() }");
        let root = ("lib.rs", "mod a; mod d;");
        let other = ("d.rs", "pub struct X;");
        assert_eq!(circle_of(&[root, declaring, child, other]), None);
        let found = circle_of(&[root, working, child, other]).unwrap();
        assert_eq!(found, ["crate::a", "crate::a::b"]);
    }
}
