//! Results of small comparisons.

use super::{assert_same, compare, comparison, files, folder, prints, small, UNSEEN};
use serde_json::Value;
use std::fs;

/// The only row for which this holds.
fn row<'a>(rows: &'a Value, fields: &[(&str, &str)]) -> &'a Value {
    let rows = rows.as_array().unwrap().iter();
    let fits = |row: &&Value| fields.iter().all(|(name, value)| row[*name] == *value);
    let rows: Vec<_> = rows.filter(fits).collect();
    assert_eq!(rows.len(), 1, "{fields:?}");
    rows[0]
}

fn by_seed(row: &Value) -> Vec<f64> {
    let all = row["by_seed"].as_array().unwrap().iter();
    all.map(|value| value.as_f64().unwrap()).collect()
}

#[test]
fn a_comparison_learns_and_says_that_nothing_is_proven() {
    let out = folder();
    let more = [
        "--rounds",
        "4",
        "--steps",
        "200",
        "--learning-rate",
        "2e-3",
        "--seeds",
        "5",
        "--unseen",
        UNSEEN,
    ];
    let reported = prints(&compare(out.path(), &more));
    let notice = "nothing in this comparison is proven";
    assert_eq!(reported.matches(notice).count(), 2, "{reported}");
    let result = comparison(out.path());
    assert_eq!(result["proven"], false);
    assert_eq!(result["confidence"], 0.95);

    // As many gradients in the centralised run as in the federation.
    let steps = |variant| row(&result["variants"], &[("variant", variant)])["steps"].clone();
    assert_eq!(
        (steps("federated"), steps("centralised"), steps("alone")),
        (1600.into(), 1600.into(), 800.into())
    );
    for node in result["nodes"].as_array().unwrap() {
        assert_eq!(node["held_out_episodes"].as_array().unwrap().len(), 1);
    }

    // All learn, and a node alone does worse on what the other recorded than the federation does. What is stated of a difference follows from
    // its interval.
    for progress in result["progress"].as_array().unwrap() {
        let points = progress["points"].as_array().unwrap();
        let loss = |point: &Value| point[1]["mean"].as_f64().unwrap();
        assert_eq!(points.len(), 5);
        assert!(loss(&points[4]) < 0.9 * loss(&points[0]), "{progress}");
    }
    let others = "held-out episodes of the other nodes";
    let gained = row(&result["differences"], &[("on", others)]);
    assert_eq!(gained["federated_minus"], "alone");
    assert!(
        gained["difference"]["mean"].as_f64().unwrap() < 0.0,
        "{gained}"
    );
    for row in result["differences"].as_array().unwrap() {
        let end = |name: &str| row["difference"][name].as_f64().unwrap();
        let shows = match (end("low"), end("high")) {
            (_, high) if high < 0.0 => "federation-is-better",
            (low, _) if low > 0.0 => "federation-is-worse",
            _ => "no-difference-shown",
        };
        assert_eq!(row["shows"], shows, "{row}");
    }

    // A difference is between losses of the same seed, and its interval is around their mean.
    let on = ("on", "unseen so100_sorting_two");
    let loss = |variant| by_seed(row(&result["losses"], &[on, ("variant", variant)]));
    let difference = row(&result["differences"], &[on, ("federated_minus", "alone")]);
    let pairs = loss("federated").into_iter().zip(loss("alone"));
    let expected: Vec<f64> = pairs.map(|(federated, alone)| federated - alone).collect();
    let found = by_seed(difference);
    assert_eq!((found.len(), expected.len()), (5, 5));
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12);
    }
    let end = |name: &str| difference["difference"][name].as_f64().unwrap();
    let mean = found.iter().sum::<f64>() / 5.0;
    assert!(end("low") < mean && mean < end("high"));
    assert!((end("mean") - mean).abs() < 1e-12);

    let chart = String::from_utf8(files(out.path())["comparison.svg"].clone()).unwrap();
    for text in [
        "centralised",
        "unseen so100_sorting_two: minus alone",
        "held-out episodes of node-2: minus node-2 alone",
    ] {
        assert!(chart.contains(text), "{text}");
    }
}

/// With as many steps as one node, centralised training ends after half as many.
#[test]
fn same_steps_decides_about_centralised_training_alone() {
    let (total, node) = (folder(), folder());
    small(total.path(), &[]);
    small(node.path(), &["--same-steps", "node"]);
    let (total, node) = (files(total.path()), files(node.path()));
    for (name, file) in total.iter().filter(|(name, _)| name.starts_with("runs/")) {
        let same = *file == node[name];
        assert_eq!(same, !name.contains("centralised"), "{name}");
    }
    let run: Value = serde_json::from_slice(&node["runs/seed-0-centralised.json"]).unwrap();
    assert_eq!(run["steps"], 12);
}

/// What is on disk after a stop at any moment is some of the files of runs, and perhaps one that is half written, under another name.
#[test]
fn a_comparison_that_was_stopped_ends_with_the_same_bytes() {
    let (whole, parts) = (folder(), folder());
    let more = |seeds| ["--seeds", seeds, "--unseen", UNSEEN, "--fedprox-mu", "0.1"];
    let threads = |count| ["--threads", count];
    let (three, two) = (more("3"), more("2"));
    small(whole.path(), &[&three[..], &threads("1")].concat());
    small(parts.path(), &[&two[..], &threads("3")].concat());
    for lost in ["seed-0-federated", "seed-1-node-2-alone"] {
        fs::remove_file(parts.path().join(format!("runs/{lost}.json"))).unwrap();
    }
    fs::remove_file(parts.path().join("comparison.json")).unwrap();
    let kept = parts.path().join("runs/seed-1-centralised.json");
    let before = fs::metadata(&kept).unwrap().modified().unwrap();
    small(
        parts.path(),
        &[&three[..], &threads("2"), &["--resume"]].concat(),
    );
    assert_eq!(fs::metadata(&kept).unwrap().modified().unwrap(), before);
    assert_same(whole.path(), parts.path());
}

#[test]
fn the_seed_and_the_strategy_decide_the_result() {
    let mut results = Vec::new();
    let clipped = r#"{"norm-clipping": {"max_norm_bps": 1}}"#;
    for more in [
        &[][..],
        &["--seed", "9"],
        &["--strategy", clipped],
        &["--fedprox-mu", "100"],
    ] {
        let out = folder();
        small(out.path(), more);
        results.push(comparison(out.path())["losses"][0]["by_seed"].to_string());
    }
    results.sort();
    results.dedup();
    assert_eq!(results.len(), 4);
}
