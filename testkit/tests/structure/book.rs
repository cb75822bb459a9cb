//! The book that `make book` builds: `docs/SUMMARY.md` has three doors and a reference, and lists each page of `docs/` once.

use super::links::targets;
use super::{read, tracked_files};

const SUMMARY: &str = "docs/SUMMARY.md";

/// The parts of the book.
const PARTS: [&str; 4] = ["Run a node", "Run an aggregator", "Audit", "Reference"];

/// Where a summary differs from the pages of its folder: those that it lists never or twice, and those that it lists and that are not there.
fn differences(summary: &str, pages: &[&str]) -> Vec<String> {
    let listed = targets(summary);
    let times = |page: &str| listed.iter().filter(|target| *target == page).count();
    let wrong = pages.iter().filter(|page| times(page) != 1);
    let wrong = wrong.map(|page| format!("{SUMMARY} lists {page} {} times", times(page)));
    let inside = listed.iter().filter(|target| !target.starts_with("../"));
    let unknown = inside.filter(|target| !pages.contains(&target.as_str()));
    let unknown = unknown.map(|target| format!("{SUMMARY} lists {target}, which is no page"));
    wrong.chain(unknown).collect()
}

#[test]
fn the_book_has_each_page_once() {
    let files = tracked_files();
    let pages = files
        .iter()
        .filter(|path| path.ends_with(".md") && *path != SUMMARY)
        .filter_map(|path| path.strip_prefix("docs/"));
    let pages: Vec<_> = pages.collect();
    assert!(pages.contains(&"audit.md"), "{pages:?}");
    let wrong = differences(&read(SUMMARY), &pages);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_book_has_three_doors_and_a_reference() {
    let summary = read(SUMMARY);
    let parts = summary.lines().filter_map(|line| line.strip_prefix("# "));
    // The first heading is the title.
    assert_eq!(parts.skip(1).collect::<Vec<_>>(), PARTS);
}

#[test]
fn a_page_that_the_book_lacks_repeats_or_invents_is_seen() {
    let summary = "# Book\n[All](../README.md)\n- [A](a.md)\n- [B](b.md)\n- [B](b.md)\n";
    assert_eq!(
        differences(summary, &["a.md", "b.md"]),
        ["docs/SUMMARY.md lists b.md 2 times"]
    );
    assert_eq!(
        differences("[A](a.md) [D](d.md)", &["a.md", "c.md"]),
        [
            "docs/SUMMARY.md lists c.md 0 times",
            "docs/SUMMARY.md lists d.md, which is no page"
        ]
    );
}
