//! The program knows every command, option and value that a page has, in blocks and in backquotes.

use crate::harness::{prints, root, words, zk0, LEDGER};
use std::collections::BTreeSet;
use std::fs;
use std::process::Command;
use zk0_testkit::pages::{commands, mentions};

/// The arguments of `zk0` in a command, with values in the place of the page's words; none if the command does not run it.
fn arguments(command: &str, log_key: &str) -> Option<Vec<String>> {
    let id = "ab".repeat(32);
    let in_quotes = |(part, text): (usize, &str)| match part % 2 {
        0 => text.to_owned(),
        _ => text.replace(' ', "_"),
    };
    let command: String = command.split('"').enumerate().map(in_quotes).collect();
    let command = command.replace("$AT", "--aggregator http://HOST:7071 --network ID");
    let all = command.split(' ').map(|word| word.trim_end_matches('…'));
    let all = all
        .filter(|word| !word.is_empty())
        .take_while(|word| *word != ">");
    let all: Vec<_> = all.collect();
    let at = all
        .iter()
        .rposition(|word| *word == "zk0" || word.ends_with("/zk0"))?;
    // `cargo build -p zk0` builds it.
    if at > 0 && all[at - 1] == "-p" {
        return None;
    }
    let value = |word: &&str| match *word {
        "ID" | "NEW" => id.clone(),
        "KEY" | "LOGKEY" => log_key.to_owned(),
        "N" | "ENTRY" => "3".to_owned(),
        word => word.replace("IDENTITY", &id),
    };
    Some(all[at + 1..].iter().map(value).collect())
}

/// All pages of the repository.
fn pages() -> Vec<String> {
    let mut git = Command::new("git");
    let listed = git.args(["ls-files", "*.md"]).current_dir(root()).output();
    let listed = String::from_utf8(listed.unwrap().stdout).unwrap();
    listed.lines().map(str::to_owned).collect()
}

#[test]
fn the_program_understands_every_command_of_our_pages() {
    let log_key = prints(&["ledger", "vkey", LEDGER]);
    let mut known = BTreeSet::new();
    let mut wrong = Vec::new();
    for page in pages() {
        let text = fs::read_to_string(root().join(&page)).unwrap();
        let mentions = mentions(&text).into_iter();
        let mentions = mentions.filter(|mention| mention.starts_with("zk0 "));
        for command in commands(&text).into_iter().chain(mentions) {
            let Some(mut arguments) = arguments(&command, log_key.trim()) else {
                continue;
            };
            // With this at its end, the program reads the whole line, and does nothing.
            arguments.push("--help".to_owned());
            if !known.insert(arguments.clone()) {
                continue;
            }
            let output = zk0(&words(&arguments)).output().unwrap();
            let why = String::from_utf8_lossy(&output.stderr).into_owned();
            // A page may name an option without its value.
            if !output.status.success() && !why.contains("a value is required for") {
                wrong.push(format!("{page}: `{command}`: {why}"));
            }
        }
    }
    assert!(known.len() > 100, "{known:?}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_arguments_of_a_command_are_found() {
    let of = |command: &str| arguments(command, "k").map(|arguments| arguments.join(" "));
    assert_eq!(of("sudo -u x a/zk0 ledger fsck …").unwrap(), "ledger fsck");
    assert_eq!(
        of("zk0 a --title \"b c\" --log-key KEY > d").unwrap(),
        "a --title b_c --log-key k"
    );
    assert_eq!(of("cargo build -p zk0 --locked"), None);
    assert_eq!(of("make demo"), None);
}
