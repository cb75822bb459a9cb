//! Runs all of these tests again, on the second committed reference.

use std::process::Command;

use crate::reference::{fixtures, is_committed};

#[test]
fn the_same_holds_for_a_policy_of_other_dimensions() {
    if !is_committed() {
        return; // This process already tests another folder
    }
    let tests = Command::new(std::env::current_exe().unwrap())
        .arg("parity::")
        .env("ZK0_PARITY_DIR", fixtures().join("smolvla_odd"))
        .output()
        .unwrap();
    let reported = String::from_utf8_lossy(&tests.stdout);
    println!("{reported}");
    assert!(tests.status.success(), "{reported}");
    assert!(!reported.contains(" 0 passed"), "{reported}");
}
