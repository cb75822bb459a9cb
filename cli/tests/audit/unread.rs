//! Commands whose reader has left, as `head` does, and commands whose output finds the disk full.

use crate::harness::{logged, zk0, LEDGER};
use std::fs::{File, OpenOptions};
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
        let reported = logged(&output);
        assert!(!reported.contains("panicked"), "{arguments:?}: {reported}");
    }
}

#[test]
fn a_watch_that_nobody_hears_ends_with_an_error() {
    let watch = ["audit", "watch", LEDGER, "--interval", "1"];
    let output = unread(&watch);
    assert_eq!(output.status.code(), Some(4), "{output:?}");
    let reported = logged(&output);
    assert!(
        reported.contains("cannot be written to standard output"),
        "{reported}"
    );
}

/// A file on a full disk.
fn full() -> File {
    OpenOptions::new().write(true).open("/dev/full").unwrap()
}

#[test]
fn a_command_whose_output_finds_the_disk_full_says_so_and_fails() {
    for (code, arguments) in [
        (1, &["ledger", "vkey", LEDGER][..]),
        (1, &["ledger", "fsck", LEDGER][..]),
        (1, &["audit", "show", LEDGER][..]),
        (1, &["audit", "prove", LEDGER, "0"][..]),
        (4, &["audit", "replay", LEDGER, "--light"][..]),
    ] {
        let output = zk0(arguments).stdout(full()).output().unwrap();
        let reported = logged(&output);
        assert_eq!(
            output.status.code(),
            Some(code),
            "{arguments:?}: {reported}"
        );
        assert!(
            reported.contains("error: writing to standard output: No space left"),
            "{arguments:?}: {reported}"
        );
    }
    // Where the log finds it full, nobody can be told, but the exit code is that of the error.
    let mut nothing = zk0(&["audit", "show", "there-is-no-such-folder"]);
    let status = nothing.stderr(full()).status().unwrap();
    assert_eq!(status.code(), Some(1));
}
