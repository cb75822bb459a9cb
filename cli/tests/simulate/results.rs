//! Results of small simulations, and what is refused.

use super::{ends, fails, folder, logged, round, simulate, small, zk0, DATASETS, SMALL};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// All files of a simulation by name.
fn files(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(out).unwrap().map(|entry| entry.unwrap());
    let files = entries.map(|entry| {
        let name = entry.file_name().into_string().unwrap();
        (name, fs::read(entry.path()).unwrap())
    });
    files.collect()
}

#[test]
fn a_simulation_learns_and_says_that_nothing_is_proven() {
    let out = folder();
    let unseen = ["--unseen", "tests/fixtures/datasets/so100_sorting_two"];
    let more = [
        "--rounds",
        "2",
        "--steps",
        "200",
        "--learning-rate",
        "1e-3",
        "--eval-frames",
        "16",
    ];
    let reported = super::prints(&simulate(out.path(), &[&more[..], &unseen].concat()));
    assert_eq!(
        reported
            .matches("nothing in this simulation is proven")
            .count(),
        2,
        "{reported}"
    );
    let (first, last) = (round(out.path(), 0), round(out.path(), 2));
    for round in [&first, &last] {
        assert_eq!(round["proven"], false);
        assert_eq!(round["nodes"].as_array().unwrap().len(), 2);
        assert_eq!(round["unseen"][0]["name"], "so100_sorting_two");
    }
    let fell = |of: &str| last[of].as_f64().unwrap() < 0.9 * first[of].as_f64().unwrap();
    assert!(fell("mean_loss"), "{first} {last}");
    assert!(first["aggregated_client_metrics"].is_null());
    assert_eq!(last["aggregated_client_metrics"]["num_clients"], 2);
    let told = &last["individual_client_metrics"][1];
    assert_eq!(told["client_id"], "node-2");
    assert_eq!(told["dataset_name"], "so100_stacking");
    assert_eq!(told["num_examples"], 249);
    let chart = String::from_utf8(files(out.path())["loss.svg"].clone()).unwrap();
    for text in [
        "mean of the nodes",
        "node-2",
        "so100_sorting_two (unseen)",
        "round",
    ] {
        assert!(chart.contains(text), "{text}");
    }
}

/// A stop between any two writes leaves what a stop after the one before leaves, or a file of a round that is written again.
#[test]
fn a_simulation_that_was_stopped_ends_with_the_same_bytes() {
    let (whole, parts) = (folder(), folder());
    let strategy = r#"{"fed-adam": {"server_rate_billionths": 1000000, "beta1_bps": 9000, "beta2_bps": 9900, "tau_billionths": 1000000}}"#;
    let options = [
        "--strategy",
        strategy,
        "--fedcm-alpha",
        "0.7",
        "--nodes",
        "5",
        "--share",
        "0.6",
    ];
    let rounds = |rounds| [&options[..], &["--rounds", rounds]].concat();
    small(
        whole.path(),
        &[&rounds("4")[..], &["--threads", "1"]].concat(),
    );
    small(
        parts.path(),
        &[&rounds("1")[..], &["--threads", "3"]].concat(),
    );
    // As if it was stopped after it had written the round, and before the state.
    fs::write(parts.path().join("round_2.json"), "{}").unwrap();
    for upto in ["3", "4"] {
        small(
            parts.path(),
            &[&rounds(upto)[..], &["--resume", "--threads", "2"]].concat(),
        );
    }
    let (whole, parts) = (files(whole.path()), files(parts.path()));
    assert_eq!(
        whole.keys().collect::<Vec<_>>(),
        parts.keys().collect::<Vec<_>>()
    );
    for (name, file) in &whole {
        assert!(*file == parts[name], "{name} differs");
    }
}

#[test]
fn each_strategy_and_the_seed_decide_the_result() {
    let mut results = BTreeMap::new();
    let strategies = [
        "fed-avg",
        r#"{"krum": {"byzantine_bps": 2000}}"#,
        r#"{"norm-clipping": {"max_norm_bps": 1}}"#,
        r#"{"fed-avg-m": {"server_rate_bps": 5000, "momentum_bps": 9000}}"#,
    ];
    let each = strategies.map(|strategy| vec!["--strategy", strategy]);
    for options in each
        .into_iter()
        .chain([vec!["--seed", "1"], vec!["--fedprox-mu", "100"]])
    {
        let out = folder();
        small(out.path(), &[&options[..], &["--rounds", "2"]].concat());
        let weights = round(out.path(), 2)["weights"].to_string();
        assert_eq!(results.insert(weights, options), None);
    }
}

#[test]
fn what_cannot_be_simulated_is_refused() {
    let out = folder();
    let refused = |more: &[&str]| fails(&simulate(out.path(), &[&SMALL, more].concat()));
    let reported = refused(&["--nodes", "50"]);
    assert!(
        reported.contains("50 nodes need 50 episodes, and the recordings have 12"),
        "{reported}"
    );
    let reported = refused(&["--share", "0"]);
    assert!(
        reported.contains("--share is 0; it has to be above 0 and at most 1"),
        "{reported}"
    );
    let wrong = zk0(&simulate(out.path(), &["--strategy", "best"]));
    let reported = logged(&ends(2, wrong));
    assert!(
        reported.contains("'best' for '--strategy <STRATEGY>': a strategy is fed-avg, median"),
        "{reported}"
    );
    let reported = refused(&["--strategy", r#"{"trimmed-mean": {"trim_bps": 5000}}"#]);
    assert!(
        reported.contains("rule strategy leaves out 5000 basis points"),
        "{reported}"
    );
    let reported = refused(&["--fedcm-alpha", "0", "--rounds", "2"]);
    assert!(reported.contains("round 1, node-1: "), "{reported}");
    let reported = refused(&["--dataset", "nowhere"]);
    assert!(
        reported.contains("error: nowhere: no such folder"),
        "{reported}"
    );
}

#[test]
fn a_folder_holds_one_simulation() {
    let out = folder();
    small(out.path(), &["--rounds", "2"]);
    let refused = |more: &[&str]| fails(&simulate(out.path(), &[&SMALL, more].concat()));
    let reported = refused(&["--rounds", "2"]);
    assert!(
        reported.contains("holds a simulation: add --resume"),
        "{reported}"
    );
    for other in [
        ["--seed", "1"],
        ["--learning-rate", "0.1"],
        ["--dataset", DATASETS[0]],
    ] {
        let reported = refused(&[&["--resume"], &other[..]].concat());
        assert!(
            reported
                .contains("is a simulation with another policy, other recordings or other options"),
            "{reported}"
        );
    }
    let reported = refused(&["--resume", "--rounds", "1"]);
    assert!(
        reported.contains("holds a simulation of 2 rounds, and --rounds is 1"),
        "{reported}"
    );
}
