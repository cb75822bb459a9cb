//! `zk0 aggregator init --calibrate`: a network founded with ranges chosen from recordings.

use crate::harness::{self, ends, logged, zk0};
use std::path::Path;
use std::process::Command;
use zk0::keys;
use zk0_circuits::EvalSpec;
use zk0_ledger::log::Ledger;

fn found(dir: &Path, ledger: &str, more: &[&str]) -> Command {
    let (ledger, key) = (dir.join(ledger), dir.join("log.key"));
    let mut arguments = vec!["aggregator", "init", ledger.to_str().unwrap()];
    arguments.extend(["--name", "calibrated", "--key", key.to_str().unwrap()]);
    arguments.push("--rules-never-change");
    arguments.extend(more);
    zk0(&arguments)
}

#[test]
fn a_network_is_founded_with_ranges_chosen_from_a_recording() {
    let dir = tempfile::tempdir().unwrap();
    let key = dir.path().join("log.key");
    ends(0, zk0(&["aggregator", "keygen", key.to_str().unwrap()]));
    for (ledger, options) in [
        ("default", vec![]),
        ("chosen", vec!["--calibrate", harness::RECORDING]),
    ] {
        ends(0, found(dir.path(), ledger, &options));
    }
    let spec = |ledger: &str| {
        let key = keys::read(&key).unwrap();
        let ledger = Ledger::open(&dir.path().join(ledger), None, key).unwrap();
        EvalSpec::decode(&ledger.state().genesis().evaluation).unwrap()
    };
    let (default, chosen) = (spec("default"), spec("chosen"));
    assert_eq!(default, EvalSpec::micro());
    assert_eq!(chosen.dims, default.dims);
    assert_ne!(chosen, default);
}

#[test]
fn a_recording_that_is_not_there_founds_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let key = dir.path().join("log.key");
    ends(0, zk0(&["aggregator", "keygen", key.to_str().unwrap()]));
    let refused = found(dir.path(), "ledger", &["--calibrate", "no/such/recording"]);
    let reported = logged(&ends(1, refused));
    assert!(
        reported.contains("error: no/such/recording: no such folder"),
        "{reported}"
    );
    assert!(!dir.path().join("ledger").exists());
}
