//! Every command of README.md and `docs/` stands in `commands.txt`, with the test or script that runs it, or with the reason why none does.

use super::{read, tracked_files};
use std::collections::BTreeSet;
use zk0_testkit::pages::commands;

const TABLE: &str = "testkit/tests/commands.txt";

/// What a command may need that tests do not have: an account of somebody, an arm, programs that are downloaded, a GPU, root, or minutes and more.
const NEEDS: [&str; 6] = ["account", "arm", "download", "gpu", "root", "time"];

/// A command, and the page that has it.
type OnPage = (String, String);

/// The rows of the table: each has what runs the command, or what it needs, and the command. A line without a space names the page of the rows
/// below it.
fn rows(table: &str) -> Vec<(String, OnPage)> {
    let mut page = "";
    let mut rows = Vec::new();
    let lines = table.lines().filter(|line| !line.starts_with('#'));
    for line in lines {
        match line.split_once(' ') {
            Some((how, command)) => {
                let on_page = (page.to_owned(), command.trim().to_owned());
                rows.push((how.to_owned(), on_page));
            }
            None => page = line,
        }
    }
    rows
}

/// What is wrong with the table: `on_pages` are the commands of all pages, and `has_test` and `has_file` know what is in the repository.
fn faults(
    rows: &[(String, OnPage)],
    on_pages: &BTreeSet<OnPage>,
    has_test: impl Fn(&str) -> bool,
    has_file: impl Fn(&str) -> bool,
) -> Vec<String> {
    let listed: BTreeSet<_> = rows.iter().map(|(_, on_page)| on_page.clone()).collect();
    let missing = on_pages.difference(&listed).map(|(page, command)| {
        format!("{page} has `{command}`, and {TABLE} does not: add what runs it")
    });
    let stale = listed
        .difference(on_pages)
        .map(|(page, command)| format!("{TABLE} has `{command}`, and {page} does not"));
    let is_known = |how: &str| match how.split_once(':') {
        Some(("test", name)) => has_test(name),
        Some(("script", path)) => has_file(path),
        Some(("needs", what)) => NEEDS.contains(&what),
        _ => false,
    };
    let unknown = rows
        .iter()
        .filter(|(how, _)| !is_known(how))
        .map(|(how, (_, command))| {
            format!("{TABLE}: `{command}` has {how}, which is no test:NAME, script:PATH or needs:WHAT, with one of {NEEDS:?}")
        });
    missing.chain(stale).chain(unknown).collect()
}

#[test]
fn each_command_of_our_pages_is_run_or_has_a_reason() {
    let files = tracked_files();
    let is_page =
        |path: &&String| *path == "README.md" || path.starts_with("docs/") && path.ends_with(".md");
    let on_pages = files.iter().filter(is_page).flat_map(|page| {
        let commands = commands(&read(page)).into_iter();
        commands.map(move |command| (page.clone(), command))
    });
    let on_pages: BTreeSet<_> = on_pages.collect();
    assert!(on_pages.len() > 100, "{on_pages:?}");
    let tests = files
        .iter()
        .filter(|path| path.ends_with(".rs") && path.contains("tests/"));
    let tests: Vec<_> = tests.map(|path| read(path)).collect();
    let faults = faults(
        &rows(&read(TABLE)),
        &on_pages,
        |name| {
            tests
                .iter()
                .any(|text| text.contains(&format!("fn {name}(")))
        },
        |path| files.iter().any(|file| file == path),
    );
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_command_without_a_row_and_a_row_without_a_command_or_a_test_are_seen() {
    let table = "# comment\na.md\ntest:runs zk0 a\nneeds:gpu zk0 b\n\nb.md\nscript:x zk0 c\n";
    let on_page = |page: &str, command: &str| (page.to_owned(), command.to_owned());
    let both = [on_page("a.md", "zk0 a"), on_page("a.md", "zk0 b")];
    let all: BTreeSet<_> = both
        .iter()
        .cloned()
        .chain([on_page("b.md", "zk0 c")])
        .collect();
    let is = |known: &'static str| move |name: &str| name == known;
    assert_eq!(faults(&rows(table), &all, is("runs"), is("x")), [""; 0]);
    let other = BTreeSet::from([on_page("a.md", "zk0 a"), on_page("b.md", "zk0 b")]);
    let found = faults(
        &rows("a.md\ntest:runs zk0 a\nneeds:luck zk0 b"),
        &other,
        is("walks"),
        is("x"),
    );
    assert_eq!(found.len(), 4, "{found:?}");
    assert!(found[0].starts_with("b.md has `zk0 b`"), "{found:?}");
    assert!(
        found[1].contains("has `zk0 b`, and a.md does not"),
        "{found:?}"
    );
    assert!(
        found[2].contains("test:runs") && found[3].contains("needs:luck"),
        "{found:?}"
    );
}
