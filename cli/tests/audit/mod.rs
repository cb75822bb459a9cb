//! `zk0 audit` as its users run it: on the committed ledger, which holds a real proof, and on ledgers that the tests make, whose nodes have
//! hostile names and whose log forks.

mod ended;
mod processor;
mod replay;
mod report;
mod show;
mod unread;
mod unsaved;
mod usage;
mod watch;
mod witnesses;

use crate::harness::{self, logged, printed, prints, text, zk0};
use std::path::Path;

/// Standard output and log of a run that ends with this code.
#[track_caller]
fn ends(code: i32, arguments: &[&str]) -> (String, String) {
    let output = harness::ends(code, zk0(arguments));
    (printed(&output), logged(&output))
}

/// The JSON that a run prints which ends with this code.
#[track_caller]
fn json(code: i32, arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&ends(code, arguments).0).unwrap()
}

fn export(ledger: &Path, out: &Path) {
    prints(&["ledger", "export", text(ledger), text(out)]);
}

/// `zk0 audit watch` that checks the log once.
fn look(code: i32, log: &Path, state: &Path, more: &[&str]) -> String {
    let watch = [
        "audit",
        "watch",
        text(log),
        "--looks",
        "1",
        "--state",
        text(state),
    ];
    ends(code, &[&watch[..], more].concat()).0
}
