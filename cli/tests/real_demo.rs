//! The whole demo with a real proof made in the run: two nodes as processes, one honest, one lazy. The proof is of mode `direct`; the lazy node
//! submits a proof of mode `succinct`. Run it alone, where you changed what `make demo` shows:
//! `cargo test --release --workspace --test cli real_demo:: -- --ignored --nocapture`.

use crate::harness::zk0;
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use zk0_circuits::EvalSpec;
use zk0_smolvla::measure::fixed_point::{dims, quantise_weights};
use zk0_smolvla::{ExpertWeights, Profile};
use zk0_weights::Format;

fn audit(ledger: &Path) -> Output {
    zk0(&["audit", "replay", "--json", ledger.to_str().unwrap()])
        .output()
        .unwrap()
}

/// Checks that the receipts of a node show, without the ledger, that its dataset, its commitment, the randomness of its challenge and the
/// decision on its submission are recorded.
fn receipts_convince(node: &Path, ledger: &Path) {
    let key = zk0(&["ledger", "vkey", ledger.to_str().unwrap()]).output();
    let key = String::from_utf8(key.unwrap().stdout).unwrap();
    let receipts: Vec<_> = fs::read_dir(node.join("receipts")).unwrap().collect();
    assert_eq!(receipts.len(), 4);
    for receipt in receipts {
        let file = receipt.unwrap().path();
        let file = file.to_str().unwrap();
        let arguments = ["audit", "verify-proof", file, "--log-key", key.trim()];
        assert!(zk0(&arguments).status().unwrap().success(), "{file}");
    }
}

/// Something that is committed.
fn fixture(name: &str) -> String {
    format!("{}/../tests/fixtures/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn only_folder(dir: &Path) -> PathBuf {
    fs::read_dir(dir).unwrap().next().unwrap().unwrap().path()
}

#[test]
#[ignore = "makes a real proof: about ten minutes and 20 GiB of memory on two cores"]
fn a_federation_ends_with_a_proven_contribution_and_a_refused_one() {
    let out = tempfile::tempdir().unwrap();
    // The network evaluates results on the last recording. It is the honest node's, in LeRobot's other format, so the result is taken: so
    // many steps on one short recording make the loss on any other recording worse.
    let recordings = ["so100_pickplace", "so100_stacking", "so100_pickplace_v21"];
    let [honest, lazy, public] = recordings.map(|name| fixture(&format!("datasets/{name}")));
    let stolen = fixture("full_size/proof.bin");
    let demo = zk0(&[
        "demo",
        "--stolen-proof",
        &stolen,
        "--nodes",
        "2",
        // So many that the claim passes under nearly every challenge.
        "--steps",
        "2000",
        "--dataset",
        &honest,
        "--dataset",
        &lazy,
        "--dataset",
        &public,
        "--out",
        out.path().to_str().unwrap(),
    ])
    .status()
    .unwrap();
    assert!(demo.success());
    let out = only_folder(out.path());

    let metrics: Value =
        serde_json::from_slice(&fs::read(out.join("metrics.json")).unwrap()).unwrap();
    let contributions = metrics["contributions"].as_array().unwrap();
    let (accepted, refused): (Vec<_>, Vec<_>) = contributions
        .iter()
        .partition(|one| one["accepted"] == true);
    assert_eq!((accepted.len(), refused.len()), (1, 1));
    assert!(accepted[0]["loss_after"].as_f64() < accepted[0]["loss_before"].as_f64());
    // The stolen proof is real, but of the program of mode `succinct`.
    let reason = refused[0]["reason"].as_str().unwrap();
    assert!(
        reason.contains("of another program than this network's"),
        "{reason}"
    );

    // LeRobot reads these weights as float32. They are the numbers of the file that the ledger names.
    let global = fs::read(out.join("global.safetensors")).unwrap();
    let config = Profile::Micro.config();
    let global = ExpertWeights::from_safetensors(&config, &global).unwrap();
    let spec = EvalSpec::new(dims(&config).unwrap());
    let quantised = quantise_weights(&spec, &global).unwrap();
    let file = Format::new(&spec).unwrap().write(&quantised);
    let digest: String = Sha256::digest(&file)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    assert_eq!(metrics["global"][0]["weights"], digest.as_str());
    // The loss falls on the recording of the honest node.
    let losses = metrics["global"][0]["losses"].as_array().unwrap();
    let whose = losses.iter().map(|loss| (&loss["node"], &loss["trains"]));
    let whose: Vec<_> = whose.collect();
    let (node, lazy, nobody) = (Value::from("node-1"), Value::from("node-2"), Value::Null);
    let (yes, no) = (Value::from(true), Value::from(false));
    assert_eq!(whose, [(&node, &yes), (&lazy, &no), (&nobody, &no)]);
    let loss = |key: &str| losses[0][key].as_f64().unwrap();
    assert!(loss("after") < loss("before"), "{}", losses[0]);
    let recorded = &metrics["global"][0]["recorded"];
    assert_eq!(recorded["taken"], true, "{recorded}");
    let png = fs::read(out.join("loss.png")).unwrap();
    assert!(
        png.starts_with(b"\x89PNG") && png.len() > 10_000,
        "the chart is drawn"
    );
    let log = fs::read_to_string(out.join("zk0.log")).unwrap();
    for process in ["demo", "aggregator", "prover", "node-1", "node-2"] {
        assert!(
            log.contains(&format!("\"process\":\"{process}\"")),
            "{process} is in the one log"
        );
    }

    let ledger = out.join("network");
    for node in ["node-1", "node-2"] {
        receipts_convince(&out.join("nodes").join(node), &ledger);
    }
    let report = audit(&ledger);
    assert_eq!(report.status.code(), Some(0));
    let report: Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!(report["verdict"], "verified");
    let proof = ledger
        .join("blobs/sha256")
        .join(accepted[0]["proof"].as_str().unwrap());
    let mut bytes = fs::read(&proof).unwrap();
    bytes[1000] ^= 1;
    fs::write(&proof, bytes).unwrap();
    assert_eq!(
        audit(&ledger).status.code(),
        Some(1),
        "a changed proof fails the audit"
    );
}
