//! The drills of `drills.txt`: all events that issue 49 names, each with a section of `docs/runbook.md` and a test, or with what is missing.

use super::{read, tracked_files};
use std::collections::BTreeSet;

const TABLE: &str = "testkit/tests/drills.txt";

/// How many events there are.
const EVENTS: usize = 19;

/// What is wrong with the table, with the runbook at `page`. `has_test` knows the test of the program `cli` with this name in this file without
/// its end.
fn faults(table: &str, page: &str, has_test: impl Fn(&str, &str) -> bool) -> Vec<String> {
    let rows = table.lines().filter(|row| !row.starts_with('#'));
    let fault = |row: &str| {
        let [_, section, test] = row.split(" | ").collect::<Vec<_>>()[..] else {
            return Some(format!("{row:?} is no event, section and test"));
        };
        let is_played = || {
            let (module, name) = test.rsplit_once("::")?;
            has_test(&module.replace("::", "/"), name).then_some(())
        };
        if !page.lines().any(|line| line == format!("## {section}")) {
            Some(format!("docs/runbook.md has no section {section:?}"))
        } else if !test.starts_with("missing: issue ") && is_played().is_none() {
            Some(format!("there is no test {test}"))
        } else {
            None
        }
    };
    rows.filter_map(fault).collect()
}

#[test]
fn each_drill_has_a_section_of_the_runbook_and_a_test() {
    let table = read(TABLE);
    let files = tracked_files();
    let has_test = |module: &str, name: &str| {
        let path = format!("cli/tests/{module}.rs");
        files.contains(&path) && read(&path).contains(&format!("fn {name}("))
    };
    let faults = faults(&table, &read("docs/runbook.md"), has_test);
    assert!(faults.is_empty(), "{TABLE}: {}", faults.join("\n"));
    let rows = table.lines().filter(|row| !row.starts_with('#'));
    let events: BTreeSet<_> = rows.filter_map(|row| row.split(" | ").next()).collect();
    assert_eq!(events.len(), EVENTS, "{events:?}");
}

#[test]
fn a_drill_without_a_section_or_a_test_is_seen() {
    let page = "# Runbook\n## It fails\n";
    let has_test = |module: &str, name: &str| module == "a/b" && name == "c";
    let right = "# comment\nx | It fails | a::b::c\ny | It fails | missing: issue 49, point 2";
    assert_eq!(faults(right, page, has_test), [""; 0]);
    let wrong = "x | It works | a::b::c\ny | It fails | a::b::d\nz | It fails | soon\nz";
    let found = faults(wrong, page, has_test);
    assert_eq!(found.len(), 4, "{found:?}");
}
