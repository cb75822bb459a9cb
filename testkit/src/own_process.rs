//! Tests that have a process of their own, because they change or measure what belongs to a whole process: its variables, its namespaces, its
//! subscriber, its memory.

use std::env;
use std::process::Command;

/// Says that this process runs one test alone.
const ALONE: &str = "ZK0_TEST_ALONE";

/// Whether this process runs a test alone.
pub fn is_alone() -> bool {
    env::var_os(ALONE).is_some()
}

/// Whether this process runs the test alone. If not, this runs it so, waits for its end, and fails if it fails. `test` is its name with its
/// modules. The words `before` are a command that runs the process, and may be none.
#[track_caller]
pub fn alone(test: &str, before: &[&str]) -> bool {
    if is_alone() {
        return true;
    }
    let program = env::current_exe().unwrap();
    let program = program.to_str().unwrap();
    let words = [before, &[program, test, "--exact", "--nocapture"]].concat();
    let mut command = Command::new(words[0]);
    let output = command.args(&words[1..]).env(ALONE, "1").output().unwrap();
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    println!("{said}");
    assert!(output.status.success(), "{test} fails in its own process");
    assert!(said.contains(" 1 passed"), "no test has the name {test}");
    false
}
