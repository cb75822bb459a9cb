//! The report for browsers holds no script, and loads nothing.

use super::ends;
use crate::harness::made_ledger::{Made, NAMES};
use crate::harness::text;
use std::fs;
use zk0_ledger::folder;
use zk0_protocol::RefusalCode;

/// The elements of a report.
const ELEMENTS: &[&str] = &[
    "!DOCTYPE",
    "html",
    "head",
    "meta",
    "title",
    "style",
    "body",
    "h1",
    "h2",
    "div",
    "code",
    "b",
    "br",
    "p",
    "ul",
    "li",
    "table",
    "thead",
    "tbody",
    "tr",
    "th",
    "td",
    "figure",
    "figcaption",
    "svg",
    "text",
    "rect",
    "line",
    "polyline",
    "circle",
];

#[test]
fn a_report_for_browsers_holds_no_script_and_loads_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, page) = (
        scratch.path().join("ledger"),
        scratch.path().join("report.html"),
    );
    let mut made = Made::found(&dir, 0);
    made.round();
    made.round();
    drop(made.ledger);
    // The lists of the datasets are not at hand.
    ends(3, &["audit", "replay", text(&dir), "--html", text(&page)]);
    let html = fs::read_to_string(&page).unwrap();
    for hostile in ["<script", "<img", "onerror=alert(1)>", "javascript:"] {
        assert!(!html.to_lowercase().contains(hostile), "{hostile}");
    }
    for shown in [
        "&lt;script&gt;alert(1)&lt;/script&gt;",
        "&amp;lt;b&amp;gt; Zoë&#39;s arm",
        "audit&lt;test&gt;",
        "INCOMPLETE",
        "Not checked:",
        "malformed proof",
    ] {
        assert!(html.contains(shown), "{shown}");
    }
    // Every '<' begins a known element. None of them loads anything or reacts to anything.
    for tag in html.split('<').skip(1) {
        let tag = tag.split('>').next().unwrap();
        let name = tag
            .trim_start_matches('/')
            .split_whitespace()
            .next()
            .unwrap();
        assert!(ELEMENTS.contains(&name), "<{tag}>");
        for attribute in ["src=", "href", "url(", " on", "http:", "https:"] {
            assert!(!tag.contains(attribute), "<{tag}>");
        }
    }
    assert!(!html.contains("url(") && !html.contains("@import"));
    assert!(html.contains("default-src 'none'"));
    assert!(html.matches("<svg").count() >= 3);
    for element in [
        "svg", "table", "tr", "td", "figure", "ul", "li", "p", "div", "text",
    ] {
        let opened = html.matches(&format!("<{element} ")).count()
            + html.matches(&format!("<{element}>")).count();
        assert_eq!(
            opened,
            html.matches(&format!("</{element}>")).count(),
            "{element}"
        );
    }
    let data = fs::read(page.with_extension("json")).unwrap();
    let data: serde_json::Value = serde_json::from_slice(&data).unwrap();
    assert_eq!(data["audit"]["verdict"], "incomplete");
    assert_eq!(data["history"]["rounds"].as_array().unwrap().len(), 2);
    assert_eq!(data["history"]["nodes"][0]["name"], NAMES[0]);
    assert_eq!(data["history"]["refusals"]["malformed proof"], 6);
    // The page shows the verdict of the audit and quotes what the audit found.
    let lies = scratch.path().join("lies");
    let mut made = Made::found(&lies, 0);
    made.lie = Some(RefusalCode::InvalidProof);
    (0..12).for_each(|_| made.round());
    drop(made.ledger);
    ends(1, &["audit", "replay", text(&lies), "--html", text(&page)]);
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("FAILED") && html.contains("class=\"fault\""));
    assert!(html.contains("refused because") && !html.contains("<script"));
    // The page has four charts: contributions, reasons, credits and losses.
    assert_eq!(html.matches("<svg").count(), 4);
    assert_eq!(html.matches("<polyline").count(), 4);
}

/// An audit may take hours, and its verdict must not get lost with the page.
#[test]
fn a_page_that_cannot_be_written_does_not_hide_the_verdict() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (dir, stranger, page) = (place("ledger"), place("stranger"), place("page.html"));
    drop(Made::found(&dir, 0).ledger);
    drop(Made::found_with(&stranger, 0, [10; 32], String::new()).ledger);
    // A folder lies where the data of the page go.
    fs::create_dir(place("page.json")).unwrap();
    let replay = ["audit", "replay", text(&dir), "--html", text(&page)];
    let (reported, why) = ends(4, &replay);
    assert!(reported.contains("INCOMPLETE"), "{reported}{why}");
    assert!(why.contains("writing ") && !why.contains("FAILED"), "{why}");
    fs::copy(folder::checkpoint(&stranger), folder::checkpoint(&dir)).unwrap();
    let (reported, why) = ends(1, &replay);
    assert!(reported.contains("FAILED"), "{reported}{why}");
    assert!(why.contains("error: the verdict is FAILED, but"), "{why}");
}
