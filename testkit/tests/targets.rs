//! The pure crates compile for browsers and for SP1's guest.

use std::process::Command;

#[test]
fn pure_crates_compile_for_browsers_and_for_the_guest() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../scripts/check-targets.sh");
    let output = Command::new(script).output().unwrap();
    let reported = String::from_utf8_lossy(&output.stderr);
    match output.status.code() {
        Some(0) => {}
        Some(2) => zk0_testkit::skipped::skipped(reported),
        _ => panic!("{reported}"),
    }
}
