//! Tests in their own process, because they change or measure its variables, namespaces, subscriber, memory, or the stderr of C libraries.

use std::env;
use std::process::{Command, Output};

/// Set in such a process.
const ALONE: &str = "ZK0_TEST_ALONE";

/// Whether this process runs one test.
pub fn is_alone() -> bool {
    env::var_os(ALONE).is_some()
}

/// Whether this process runs the test alone. If not, this runs it so, perhaps by the command `before`, and fails if it fails. `test`
/// includes its modules.
#[track_caller]
pub fn alone(test: &str, before: &[&str]) -> bool {
    if !is_alone() {
        run(test, before);
    }
    is_alone()
}

/// The test's stderr in its own process; `None` within it. Fails if the test fails.
#[track_caller]
pub fn stderr_alone(test: &str) -> Option<String> {
    let reported = (!is_alone()).then(|| run(test, &[]).stderr)?;
    Some(String::from_utf8_lossy(&reported).into_owned())
}

#[track_caller]
fn run(test: &str, before: &[&str]) -> Output {
    let program = env::current_exe().unwrap();
    let program = program.to_str().unwrap();
    let words = [before, &[program, test, "--exact", "--nocapture"]].concat();
    let mut command = Command::new(words[0]);
    let output = command.args(&words[1..]).env(ALONE, "1").output().unwrap();
    let reported = [&output.stdout[..], &output.stderr].concat();
    let reported = String::from_utf8_lossy(&reported);
    println!("{reported}");
    assert!(output.status.success(), "{test} fails in its own process");
    assert!(
        reported.contains(" 1 passed"),
        "no test has the name {test}"
    );
    output
}
