//! Tests that cannot run on this machine.

use std::env;
use std::fmt::Display;
use std::io::{self, Write};

/// The environment variable with which a check that cannot run is a failure. Continuous integration sets it.
const ALL: &str = "ZK0_CHECK_ALL";

/// Says that the test that calls this does not run, and why. Whoever runs all checks gets a failure.
#[track_caller]
pub fn skipped(why: impl Display) {
    assert!(env::var_os(ALL).is_none(), "this cannot run here: {why}");
    // The harness would hide what `eprintln!` prints.
    let _ = writeln!(io::stderr(), "SKIPPED: {why}");
}
