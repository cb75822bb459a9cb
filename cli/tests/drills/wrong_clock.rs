//! The clock of an aggregator jumps, as the program sees it (`shim/wrong_clock.c`). This needs a C compiler, as Rust does, but not root.
#![cfg(target_os = "linux")]

use super::{closed, Operated};
use crate::harness::accepting::now_ms;
use crate::harness::drill::Drill;
use crate::harness::text;
use std::fs;
use std::process::Command;
use tempfile::TempDir;
use zk0_testkit::until;

/// A clock that somebody can set.
struct WrongClock(TempDir);

impl WrongClock {
    fn new() -> Self {
        let clock = Self(tempfile::tempdir().unwrap());
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/shim/wrong_clock.c");
        let compile = ["-shared", "-fPIC", "-O2", "-o", &clock.path("clock.so")];
        let compiled = Command::new("cc").args(compile).arg(source).output();
        let compiled = compiled.unwrap();
        let complained = String::from_utf8_lossy(&compiled.stderr);
        assert!(compiled.status.success(), "{complained}");
        clock.set(0);
        clock
    }

    fn path(&self, name: &str) -> String {
        text(&self.0.path().join(name)).to_owned()
    }

    /// Shows a time that is ahead by so many seconds.
    fn set(&self, seconds: u64) {
        fs::write(self.path("next"), seconds.to_string()).unwrap();
        fs::rename(self.path("next"), self.path("ahead")).unwrap();
    }
}

#[test]
fn a_wrong_clock_records_nothing_and_ends_no_round() {
    let clock = WrongClock::new();
    let windows = |rules: &mut serde_json::Value| rules["commit_window_ms"] = 500.into();
    let network = Operated::found(&["governor"], windows);
    let variables = [
        ("LD_PRELOAD", clock.path("clock.so")),
        ("ZK0_CLOCK_AHEAD", clock.path("ahead")),
    ];
    let variables = variables.each_ref().map(|(name, value)| (*name, &**value));
    let aggregator = network.serves_with(&["--min-nodes", "0"], &variables);
    network.closes(1);

    let mut drill = Drill::begin("the clock is wrong");
    drill.shortened = Some("the clock is wrong for seconds, and its program alone sees that");
    clock.set(7_200);
    aggregator.logs("s ahead. An entry with such a time could not be undone, so none is recorded");
    let before = network.entries();
    until("the operator sees it", || network.has_trouble("clock"));
    assert_eq!(network.entries(), before);
    assert!(before.last().unwrap().time_ms < now_ms() + 60_000);
    clock.set(0);
    network.closes(closed(&before) + 1);
    until("all is well", || !network.has_trouble("clock"));
    assert_eq!(network.entries()[..before.len()], before);
    drill.passed();
}
