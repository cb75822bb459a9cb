//! `zk0 compare --search`.

use super::{assert_same, comparison, fails, files, folder, small, SMALL};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

const SEARCH: [&str; 5] = [
    "--search",
    "--search-trials",
    "7",
    "--learning-rate",
    "1e-3",
];

fn trials(out: &Path, kind: &str) -> Vec<Value> {
    let result = comparison(out);
    let trials = result["search"]["trials"].as_array().unwrap().iter();
    trials
        .filter(|trial| trial["kind"] == kind)
        .cloned()
        .collect()
}

#[test]
fn a_search_chooses_on_episodes_that_the_comparison_does_not_report_on() {
    let out = folder();
    let reported = small(out.path(), &SEARCH);
    assert!(reported.contains("chosen among 7 trials"), "{reported}");
    let result = comparison(out.path());
    for (node, validation) in result["search"]["validation_episodes"]
        .as_array()
        .unwrap()
        .iter()
        .enumerate()
    {
        let names = |list: &Value| -> BTreeSet<String> {
            let list = list.as_array().unwrap().iter();
            list.map(ToString::to_string).collect()
        };
        let (validation, reported) = (
            names(validation),
            names(&result["nodes"][node]["held_out_episodes"]),
        );
        assert!(!validation.is_empty() && !reported.is_empty());
        assert!(validation.is_disjoint(&reported), "{validation:?}");
    }
    // Each kind trains with the values of its best trial, and the first trial has what was given.
    for variant in result["variants"].as_array().unwrap() {
        let trials = trials(out.path(), variant["variant"].as_str().unwrap());
        assert_eq!(trials.len(), 7);
        assert_eq!(trials[0]["values"]["learning_rate"], 1e-3);
        let loss = |trial: &&Value| trial["loss"].as_f64().unwrap_or(f64::INFINITY);
        let best = trials.iter().min_by(|a, b| loss(a).total_cmp(&loss(b)));
        assert_eq!(variant["values"], best.unwrap()["values"]);
    }
}

/// The values that were chosen, given without a search, make the same runs.
#[test]
fn a_search_changes_nothing_but_the_values() {
    let (searched, given) = (folder(), folder());
    let only_rates = ["--search-mu", "0", "--search-strategy", "fed-avg"];
    small(searched.path(), &[&SEARCH[..], &only_rates].concat());
    let result = comparison(searched.path());
    let rate = result["variants"][0]["values"]["learning_rate"].to_string();
    small(given.path(), &["--learning-rate", &rate]);
    let run = |out: &Path| files(out)["runs/seed-1-federated.json"].clone();
    assert!(run(searched.path()) == run(given.path()));
}

#[test]
fn a_search_that_was_stopped_ends_with_the_same_bytes() {
    let (whole, parts) = (folder(), folder());
    small(whole.path(), &SEARCH);
    small(parts.path(), &SEARCH);
    // As if it was stopped in the fifth trial of nodes alone, after those of the others.
    fs::remove_dir_all(parts.path().join("runs")).unwrap();
    for lost in [
        "ended",
        "alone-5",
        "federated-6",
        "centralised-6",
        "alone-6",
    ] {
        fs::remove_file(parts.path().join(format!("trials/{lost}.json"))).unwrap();
    }
    for kind in ["federated", "centralised", "alone"] {
        fs::remove_file(parts.path().join(format!("trials/{kind}-7.json"))).unwrap();
    }
    small(parts.path(), &[&SEARCH[..], &["--resume"]].concat());
    assert_same(whole.path(), parts.path());
}

/// A search whose time is over has made one trial of each, and a later call does not go on with it.
#[test]
fn a_search_ends_when_its_time_is_over() {
    let out = folder();
    let short = ["--search-minutes", "1e-9"];
    small(out.path(), &[&SEARCH[..], &short].concat());
    for kind in ["federated", "centralised", "alone"] {
        assert_eq!(trials(out.path(), kind).len(), 1);
    }
    let before = files(out.path());
    small(out.path(), &[&SEARCH[..], &["--resume"]].concat());
    assert!(before == files(out.path()));
}

#[test]
fn trials_that_diverge_are_no_end_of_the_search() {
    let out = folder();
    let wild = ["--learning-rate", "1e2", "--search-factor", "1e5"];
    small(
        out.path(),
        &[&["--search", "--search-trials", "9"][..], &wild].concat(),
    );
    let all = ["federated", "centralised", "alone"];
    let failed = all.iter().flat_map(|kind| trials(out.path(), kind));
    let failed: Vec<_> = failed.filter(|trial| trial["loss"].is_null()).collect();
    assert!(!failed.is_empty());
    assert!(failed.iter().all(|trial| trial["failed"].is_string()));

    let out = folder();
    let none = [
        "--search",
        "--search-trials",
        "1",
        "--learning-rate",
        "1e30",
    ];
    let none = [&SMALL[..], &none].concat();
    let reported = fails(&super::compare(out.path(), &none));
    assert!(
        reported.contains("1 trial of federated failed, so there is nothing to choose from"),
        "{reported}"
    );
}
