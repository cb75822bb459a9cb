//! Flags, variables, the file and defaults of a small command.

use clap::{Parser, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;
use std::{env, fs};
use zk0::settings::parse_from;
use zk0_testkit::own_process::alone;

#[derive(Debug, Parser)]
struct Cli {
    #[command(subcommand)]
    group: Group,
}

#[derive(Debug, Subcommand)]
enum Group {
    #[command(subcommand)]
    Witness(Service),
}

#[derive(Debug, Subcommand)]
enum Service {
    Serve(Settings),
}

#[derive(Debug, clap::Args)]
struct Settings {
    dir: PathBuf,
    #[arg(long, default_value_t = 1)]
    number: u64,
    #[arg(long = "server")]
    servers: Vec<String>,
    #[arg(long)]
    quiet: bool,
    #[arg(long, requires = "secret", conflicts_with = "quiet")]
    sealed: bool,
    #[arg(long, requires = "secret")]
    certificate: Option<String>,
    #[arg(long)]
    secret: Option<String>,
}

/// Whether this process runs this test alone, and may set variables. If not, this runs it so.
#[track_caller]
fn may_set_variables(test: &str) -> bool {
    alone(&format!("services::settings::{test}"), &[])
}

fn parsed(file: &str, more: &[&str]) -> Result<Settings, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("witness.toml");
    fs::write(&path, file).unwrap();
    let mut arguments: Vec<OsString> = vec!["zk0".into(), "witness".into(), "serve".into()];
    arguments.extend(["--config".into(), path.into()]);
    arguments.extend(more.iter().map(Into::into));
    match parse_from::<Cli>(arguments) {
        Ok(Cli {
            group: Group::Witness(Service::Serve(settings)),
        }) => Ok(settings),
        Err(error) => Err(error.to_string()),
    }
}

const ALL: &str = "dir = 'store'\nnumber = 2\nserver = ['a', 'b']\nquiet = true\n";

#[test]
fn a_flag_counts_before_a_variable_that_before_the_file_and_that_before_the_default() {
    if !may_set_variables(
        "a_flag_counts_before_a_variable_that_before_the_file_and_that_before_the_default",
    ) {
        return;
    }
    let number = |file, more: &[&str]| parsed(file, more).unwrap().number;
    assert_eq!(number("dir = 'store'", &[]), 1);
    assert_eq!(number(ALL, &[]), 2);
    env::set_var("ZK0_WITNESS_NUMBER", "3");
    assert_eq!(number(ALL, &[]), 3);
    assert_eq!(number(ALL, &["--number", "4"]), 4);
}

#[test]
fn a_file_holds_arguments_lists_and_switches() {
    let settings = parsed(ALL, &[]).unwrap();
    assert_eq!(settings.dir, PathBuf::from("store"));
    assert_eq!(settings.servers, ["a", "b"]);
    assert!(settings.quiet);
    // What a flag states replaces the list of the file.
    let settings = parsed(ALL, &["other", "--server", "c"]).unwrap();
    assert_eq!(settings.dir, PathBuf::from("other"));
    assert_eq!(settings.servers, ["c"]);
    assert!(!parsed("dir = 'store'\nquiet = false", &[]).unwrap().quiet);
}

#[test]
fn variables_hold_arguments_lists_switches_and_the_name_of_the_file() {
    if !may_set_variables("variables_hold_arguments_lists_switches_and_the_name_of_the_file") {
        return;
    }
    env::set_var("ZK0_WITNESS_DIR", "other");
    env::set_var("ZK0_WITNESS_SERVER", "c,d");
    env::set_var("ZK0_WITNESS_QUIET", "false");
    let settings = parsed(ALL, &[]).unwrap();
    assert_eq!(settings.dir, PathBuf::from("other"));
    assert_eq!(settings.servers, ["c", "d"]);
    assert!(!settings.quiet);
    env::set_var("ZK0_WITNESS_CONFIG", "missing.toml");
    let refused = parse_from::<Cli>(["zk0", "witness", "serve"].map(Into::into).into());
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("missing.toml"), "{refused}");
}

/// Checks that the file is refused with these words.
#[track_caller]
fn refused(file: &str, words: &[&str]) {
    let error = parsed(file, &[]).unwrap_err();
    for word in words {
        assert!(error.contains(word), "{word:?} is not in {error}");
    }
}

#[test]
fn what_is_wrong_in_a_file_is_refused_with_its_key_and_line() {
    refused(
        "dir = 'x'\n\nnumbr = 2\n",
        &[
            "witness.toml, line 3: numbr: ",
            "has no such setting",
            "number",
        ],
    );
    let line = "witness.toml, line 2: ";
    refused(
        "dir = 'x'\nnumber = 'two'",
        &[line, "--number", "invalid digit"],
    );
    refused("dir = 'x'\nnumber = -2", &[line, "--number", "-2"]);
    refused(
        "dir = 'x'\nnumber = [2]",
        &[line, "number: this setting is one text"],
    );
    refused(
        "dir = 'x'\nnumber = true",
        &[line, "number: this setting is one text"],
    );
    refused(
        "dir = 'x'\nserver = 'a'",
        &[line, "server: this setting is a list"],
    );
    refused(
        "dir = 'x'\nquiet = 1",
        &[line, "quiet: this setting is true or false"],
    );
    refused(
        "dir = 'x'\n[witness]\nnumber = 2",
        &[line, "witness: ", "no such setting"],
    );
    refused(
        "dir = 'x'\nconfig = 'y'",
        &[line, "config: ", "no such setting"],
    );
    refused("dir = 'x'\nnumber = ", &["witness.toml: ", "line 2"]);
    refused(
        "number = 1\nnumber = 2",
        &["witness.toml: ", "line 2", "duplicate key"],
    );
    // What belongs together has to be together, wherever it is stated.
    refused("dir = 'x'\ncertificate = 'y'", &["--secret"]);
    assert!(parsed("dir = 'x'\ncertificate = 'y'", &["--secret", "z"]).is_ok());
    refused("number = 2", &["<DIR>"]);
}

#[test]
fn a_switch_that_a_variable_turns_off_needs_nothing_and_conflicts_with_nothing() {
    if !may_set_variables(
        "a_switch_that_a_variable_turns_off_needs_nothing_and_conflicts_with_nothing",
    ) {
        return;
    }
    env::set_var("ZK0_WITNESS_SEALED", "false");
    assert!(!parsed(ALL, &[]).unwrap().sealed);
    // It counts before the file all the same.
    let file = "dir = 'x'\nsealed = true\nsecret = 'y'";
    assert!(!parsed(file, &[]).unwrap().sealed);
    let flags = ["--sealed", "--secret", "z"];
    assert!(parsed("dir = 'x'", &flags).unwrap().sealed);
    env::set_var("ZK0_WITNESS_SEALED", "true");
    refused("dir = 'x'", &["--secret"]);
    env::set_var("ZK0_WITNESS_SEALED", "no");
    refused(ALL, &["--sealed", "no"]);
}

#[test]
fn a_wrong_variable_is_refused_although_the_file_is_right() {
    if !may_set_variables("a_wrong_variable_is_refused_although_the_file_is_right") {
        return;
    }
    env::set_var("ZK0_WITNESS_NUMBER", "two");
    let variable = "the environment variable ZK0_WITNESS_NUMBER: ";
    refused(ALL, &[variable, "--number", "two"]);
    // A flag that is wrong, too, is what counts.
    let error = parsed(ALL, &["--number", "three"]).unwrap_err();
    assert!(error.contains("three"), "{error}");
    assert!(!error.contains("ZK0_WITNESS_NUMBER"), "{error}");
}
