//! Shows for every check of the statement that a cheat passes without the check and fails with it.
//!
//! This test builds a copy of the crate in which each check has a switch that takes it out at run time, and tries a cheat (`testkit/src/cheats/`)
//! without each. `deletion/checks.rs` lists what is deleted.
//!
//! `cargo test --release -p zk0-circuits --test circuits deletion -- --nocapture` prints what is deleted and what passes.

mod checks;

use checks::{Deletion, DELETIONS};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use zk0_testkit::changed_copy::OUT;
use zk0_testkit::cheats::{try_cheat, CHEATS};

#[test]
fn every_check_stops_a_cheat() {
    let workspace = Workspace::copy();
    let moved: Vec<String> = DELETIONS
        .iter()
        .filter_map(|deletion| workspace.switch(deletion).err())
        .collect();
    assert!(moved.is_empty(), "{}", moved.join("\n"));
    workspace.build();

    let mut wrong = vec![];
    for deletion in DELETIONS {
        let Deletion { check, cheat, .. } = deletion;
        let with = match try_cheat(cheat) {
            Ok(()) => "accepted".to_string(),
            Err(why) => format!("refused: {why}"),
        };
        let without = workspace.try_cheat(deletion);
        println!("{check}\n  deleted   {}", deletion.text());
        println!("  cheat     {cheat}\n  with      {with}\n  without   {without}\n");
        if !with.starts_with("refused: ") || !with.contains(deletion.refused) {
            wrong.push(format!("'{check}' does not refuse '{cheat}': {with}"));
        }
        let passed = match deletion.still_refused {
            None => without == "accepted",
            Some(why) => without.starts_with("refused: ") && without.contains(why),
        };
        if !passed {
            wrong.push(format!("without '{check}', '{cheat}' is {without}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_cheat_is_used() {
    for (name, _) in CHEATS {
        let used = DELETIONS.iter().any(|deletion| deletion.cheat == *name);
        assert!(used, "no check is deleted for the cheat '{name}'");
    }
}

/// A workspace of this crate and the program that cheats, beside the build that this test is part of.
struct Workspace {
    folder: PathBuf,
}

impl Workspace {
    fn copy() -> Self {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let root = here.parent().expect("the crate is in a workspace");
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("deletion");
        let copy = |from: PathBuf, to: &str| {
            let to = folder.join(to);
            let _ = fs::remove_dir_all(&to); // An earlier run may have left this folder
            copy_folder(&from, &to);
        };
        // The crate is built from these folders, without its tests.
        for name in ["src", "tables", "elf"] {
            copy(here.join(name), &format!("circuits/{name}"));
        }
        let manifest = read(&here.join("Cargo.toml"));
        let (manifest, _of_tests) = manifest
            .split_once("[dev-dependencies]")
            .expect("a line '[dev-dependencies]' in the crate's Cargo.toml");
        write(&folder.join("circuits/Cargo.toml"), manifest);
        for name in ["cheats", "claims"] {
            let from = root.join("testkit/src").join(name);
            copy(from, &format!("cheats/src/{name}"));
        }
        write(&folder.join("cheats/src/main.rs"), PROGRAM);
        write(&folder.join("cheats/Cargo.toml"), PROGRAM_MANIFEST);
        // The dependencies have the versions of the workspace. Only the members differ.
        let manifest = read(&root.join("Cargo.toml"));
        let members = manifest.lines().find(|line| line.starts_with("members = "));
        let members = members.expect("a line 'members = …' in the workspace's Cargo.toml");
        let manifest = manifest.replace(members, "members = [\"circuits\", \"cheats\"]");
        write(&folder.join("Cargo.toml"), manifest + PROFILE);
        write(&folder.join("Cargo.lock"), read(&root.join("Cargo.lock")));
        Self { folder }
    }

    /// Gives a check its switch.
    fn switch(&self, deletion: &Deletion) -> Result<(), String> {
        let place = self.folder.join("circuits/src").join(deletion.file);
        write(&place, deletion.switched(&read(&place))?);
        Ok(())
    }

    /// Builds the program that cheats.
    fn build(&self) {
        let built = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--offline", "--profile", "weakened"])
            .args(["--package", "cheats"])
            .env("CARGO_TARGET_DIR", self.folder.join("target"))
            .current_dir(&self.folder)
            .status();
        assert!(built.expect("cargo runs").success());
    }

    /// Tries the cheat without the check. Returns what the program prints.
    fn try_cheat(&self, deletion: &Deletion) -> String {
        let output = Command::new(self.folder.join("target/weakened/cheats"))
            .arg(deletion.cheat)
            .env(OUT, deletion.check)
            .output()
            .expect("the program runs");
        match output.status.success() {
            true => String::from_utf8_lossy(&output.stdout).trim().to_string(),
            false => format!("not tried:\n{}", String::from_utf8_lossy(&output.stderr)),
        }
    }
}

fn copy_folder(from: &Path, to: &Path) {
    let entries = fs::read_dir(from).unwrap_or_else(|error| panic!("{}: {error}", from.display()));
    for entry in entries {
        let path = entry.expect("an entry of the folder").path();
        let to = to.join(path.file_name().expect("an entry has a name"));
        match path.is_dir() {
            true => copy_folder(&path, &to),
            false => write(&to, fs::read(&path).expect("a file of the crate")),
        }
    }
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn write(path: &Path, content: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().expect("a file in a folder"))
        .and_then(|()| fs::write(path, content))
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// A profile that builds quickly. Arithmetic wraps silently, as it does in the guest.
const PROFILE: &str = r#"
[profile.weakened]
inherits = "release"
opt-level = 1
"#;

const PROGRAM_MANIFEST: &str = r#"[package]
name = "cheats"
edition.workspace = true

[dependencies]
zk0-circuits.workspace = true
"#;

/// Tries the cheat that its argument names on the crate it was built with. Prints `accepted`, or why the claim was refused.
const PROGRAM: &str = r#"
#![allow(dead_code)] // The cheats use only a part of the claims

mod cheats;
mod claims;

fn main() {
    let name = std::env::args().nth(1);
    let name = name.expect("usage: cheats NAME");
    match cheats::try_cheat(&name) {
        Ok(()) => println!("accepted"),
        Err(why) => println!("refused: {why}"),
    }
}
"#;
