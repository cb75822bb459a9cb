//! Go's `sumdb/note` and `sumdb/tlog` verify our checkpoints, cosignatures and proofs (Debian: `golang-go golang-golang-x-mod-dev`). If
//! they are not installed, the test states it and passes.

use crate::network::log::log_vkey;
use crate::network::*;
use ed25519_dalek::SigningKey;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use zk0_ledger::Ledger;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::{TlogProof, WitnessPolicy};

/// Where Debian installs Go's packages.
const GOPATH: &str = "/usr/share/gocode";

fn build(dir: &Path) -> Option<std::path::PathBuf> {
    let installed = Path::new(GOPATH)
        .join("src/golang.org/x/mod/sumdb/note")
        .is_dir();
    if !installed || Command::new("go").arg("version").output().is_err() {
        zk0_testkit::skipped::skipped(
            "there is no Go with golang-golang-x-mod-dev; scripts/setup.sh guest installs it",
        );
        return None;
    }
    let program = dir.join("verify");
    let built = Command::new("go")
        .args(["build", "-o"])
        .arg(&program)
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/go/verify.go"))
        .env("GO111MODULE", "off")
        .env("GOPATH", GOPATH)
        .env("GOFLAGS", "")
        .env("GOCACHE", dir.join("cache"))
        .output()
        .unwrap();
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    Some(program)
}

#[test]
fn go_verifies_what_we_sign() {
    let scratch = tempfile::tempdir().unwrap();
    let Some(program) = build(scratch.path()) else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    for node in 0..12 {
        ledger.append(T0, enrolled(node)).unwrap();
    }
    let cosigner = Cosigner::new("witness.example/w", SigningKey::from_bytes(&[200; 32])).unwrap();
    let policy = format!("witness W {}\nquorum W\n", cosigner.key());
    let policy = WitnessPolicy::parse(&policy).unwrap();
    let file = scratch.path().join("proof");
    let go = |proof: &[u8]| -> Output {
        fs::write(&file, proof).unwrap();
        Command::new(&program)
            .args([log_vkey().to_string(), cosigner.key().to_string()])
            .arg(&file)
            .output()
            .unwrap()
    };
    for index in [0, 5, 12] {
        let mut proof = TlogProof::from(ledger.receipt(index).unwrap());
        let end = proof
            .checkpoint
            .windows(2)
            .position(|pair| pair == b"\n\n")
            .unwrap();
        let cosignature = cosigner.cosign(&proof.checkpoint[..=end], 1_700_000_000);
        proof.checkpoint.extend(cosignature);
        let (witnessed, _) = proof.verify(&log_vkey(), &policy).unwrap();
        let text = proof.encode();
        let verified = go(&text);
        let reported = String::from_utf8(verified.stdout).unwrap();
        let root = witnessed.checkpoint.root;
        assert_eq!(
            reported,
            format!("2 signatures, entry {index} of 13, root {root}\n")
        );
        // Go refuses what our code refuses.
        for position in (0..text.len()).step_by(text.len() / 20) {
            let mut changed = text.clone();
            changed[position] ^= 1;
            let ours = TlogProof::decode(&changed)
                .is_ok_and(|proof| proof.verify(&log_vkey(), &policy).is_ok());
            assert!(!ours);
            let theirs = go(&changed);
            let reported = String::from_utf8_lossy(&theirs.stdout).into_owned();
            // Go accepts a checkpoint with one known signature of the two.
            assert!(
                !theirs.status.success() || reported.starts_with("1 signatures"),
                "byte {position}: {reported}"
            );
        }
    }
}
