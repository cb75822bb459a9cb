//! What CONTRIBUTING.md promises about the tree, checked: crates, files, names and links. It reads and builds nothing.

mod book;
mod circles;
mod commands;
mod drills;
mod files;
mod links;
mod map;
mod once;
mod paths;
mod tokens;
mod type_names;

use std::path::Path;
use std::process::Command;

/// The root of the repository.
fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// What a command prints when it is run at the root.
fn output(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program)
        .args(arguments)
        .current_dir(root())
        .output()
        .unwrap_or_else(|e| panic!("{program}: {e}"));
    assert!(
        output.status.success(),
        "{program} {arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// The tracked files that exist, by their paths from the root.
fn tracked_files() -> Vec<String> {
    output("git", &["ls-files", "-z"])
        .split_terminator('\0')
        .filter(|path| root().join(path).exists())
        .map(str::to_owned)
        .collect()
}

/// The text of a tracked file.
fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}
