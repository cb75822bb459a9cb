//! Commands whose reader has left, as `head` does.

use crate::harness::{logged, zk0, LEDGER};
use std::io;
use std::process::Output;

/// Runs a command whose standard output nobody reads.
fn unread(arguments: &[&str]) -> Output {
    let (reader, writer) = io::pipe().unwrap();
    drop(reader);
    zk0(arguments).stdout(writer).output().unwrap()
}

#[test]
fn a_command_whose_reader_has_left_says_nothing_and_keeps_its_exit_code() {
    let elsewhere = "00".repeat(32);
    for arguments in [
        &["audit", "show", LEDGER][..],
        &["audit", "show", LEDGER, "--json"],
        &["audit", "replay", LEDGER],
        &["audit", "replay", LEDGER, "--network", &elsewhere],
        &["ledger", "fsck", LEDGER],
    ] {
        let code = zk0(arguments).output().unwrap().status.code();
        let output = unread(arguments);
        assert_eq!(output.status.code(), code, "{arguments:?}: {output:?}");
        let said = logged(&output);
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
    }
}

#[test]
fn a_watch_that_nobody_hears_ends_with_an_error() {
    let watch = ["audit", "watch", LEDGER, "--interval", "1"];
    let output = unread(&watch);
    assert_eq!(output.status.code(), Some(4), "{output:?}");
    let said = logged(&output);
    assert!(
        said.contains("cannot be written to standard output"),
        "{said}"
    );
}
