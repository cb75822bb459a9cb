//! The links of our pages lead somewhere.

use super::{read, root, tracked_files};
use std::collections::BTreeSet;

/// Returns the parts of a page that are neither in a code block nor in backquotes.
fn prose(page: &str) -> String {
    let mut in_block = false;
    let lines = page.lines().filter(|line| {
        let fence = line.trim_start().starts_with("```");
        in_block ^= fence;
        !in_block && !fence
    });
    let lines: Vec<_> = lines.collect();
    lines
        .join("\n")
        .split('`')
        .step_by(2)
        .collect::<Vec<_>>()
        .join("code")
}

/// The targets of `[text](target)`, `[text]: target`, `href="target"` and `src="target"`.
pub(super) fn targets(page: &str) -> Vec<String> {
    let prose = prose(page);
    let ends = [("](", ')'), ("href=\"", '"'), ("src=\"", '"')];
    let mut targets = Vec::new();
    for (before, after) in ends {
        let found = prose.split(before).skip(1);
        targets.extend(found.filter_map(|rest| rest.split(after).next()));
    }
    for line in prose.lines().filter(|line| line.starts_with('[')) {
        targets.extend(line.split_once("]: ").map(|(_, target)| target));
    }
    let without_title = |target: &str| target.split(' ').next().map(str::to_owned);
    targets.into_iter().filter_map(without_title).collect()
}

/// The anchors that GitHub and mdBook give the headings of a page.
fn anchors(page: &str) -> BTreeSet<String> {
    let mut in_block = false;
    let mut anchors = BTreeSet::new();
    for line in page.lines() {
        in_block ^= line.starts_with("```");
        let heading = line.trim_start_matches('#');
        if in_block || heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        // The heading shows only the text of a link.
        let mut shown = String::new();
        for part in heading.trim().split("](") {
            let after = if shown.is_empty() {
                part
            } else {
                part.split_once(')').map_or("", |(_, after)| after)
            };
            shown.push_str(after);
        }
        let anchor: String = shown
            .to_lowercase()
            .chars()
            .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
            .map(|c| if c == ' ' { '-' } else { c })
            .collect();
        let again = (1..).map(|number| format!("{anchor}-{number}"));
        let free = [anchor.clone()].into_iter().chain(again);
        let free = free.into_iter().find(|name| !anchors.contains(name));
        anchors.extend(free);
    }
    anchors
}

/// Returns the links of a page that lead nowhere. `file` reads a page by its path from the root, and returns none if there is no
/// such file or folder.
fn broken(path: &str, page: &str, file: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
    let leads_somewhere = |target: &str| {
        let (to, anchor) = target.split_once('#').unwrap_or((target, ""));
        let mut names: Vec<_> = folder.split('/').filter(|name| !name.is_empty()).collect();
        for name in to.split('/') {
            match name {
                "" | "." => (),
                ".." => drop(names.pop()),
                name => names.push(name),
            }
        }
        let to = if to.is_empty() {
            path.to_owned()
        } else {
            names.join("/")
        };
        let Some(text) = file(&to) else {
            return false;
        };
        anchor.is_empty() || !to.ends_with(".md") || anchors(&text).contains(anchor)
    };
    targets(page)
        .into_iter()
        .filter(|target| !target.contains("://") && !target.starts_with("mailto:"))
        .filter(|target| !leads_somewhere(target))
        .map(|target| format!("{path}: {target} leads nowhere"))
        .collect()
}

#[test]
fn every_link_of_our_pages_leads_somewhere() {
    let file = |path: &str| {
        let whole = root().join(path);
        whole
            .exists()
            .then(|| String::from_utf8_lossy(&std::fs::read(whole).unwrap_or_default()).into())
    };
    let pages = tracked_files()
        .into_iter()
        .filter(|path| path.ends_with(".md"));
    let pages: Vec<_> = pages.collect();
    assert!(pages.contains(&"README.md".into()) && pages.contains(&"docs/audit.md".into()));
    let broken: Vec<_> = pages
        .iter()
        .flat_map(|path| broken(path, &read(path), file))
        .collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn a_link_to_no_file_and_one_to_no_heading_are_seen() {
    let here = "# What *is* it? `a_b`, and more\n\
        [self](#what-is-it-a_b-and-more) [there](../README.md#one-1) ![picture](picture.png \"title\")\n\
        [web](https://example.org/x) `[code](nowhere)`\n\
        ```\n[block](nowhere)\n```\n\
        [later]: ./picture.png\n";
    let file = |path: &str| match path {
        "docs/here.md" => Some(here.to_owned()),
        "README.md" => Some("# [One](two)\n# One\n".to_owned()),
        "docs/picture.png" => Some(String::new()),
        _ => None,
    };
    assert_eq!(broken("docs/here.md", here, file), [""; 0]);
    let wrong = "[a](#no) [b](../README.md#two) [c](nowhere.md)\n<img src=\"no.png\">\n[d]: no.md";
    assert_eq!(
        broken("docs/here.md", wrong, file),
        ["#no", "../README.md#two", "nowhere.md", "no.png", "no.md"]
            .map(|target| format!("docs/here.md: {target} leads nowhere"))
    );
}
