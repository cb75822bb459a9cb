//! What a witness logs about a log whose checkpoint it does not cosign.

use crate::harness::made_ledger::Made;
use crate::harness::serving::Serving;
use crate::harness::{prints, text};
use std::time::Duration;
use zk0_circuits::Digest;
use zk0_ledger::published::http_client::HttpClient;
use zk0_protocol::tlog::witness::AddCheckpoint;

#[test]
fn a_witness_accuses_a_log_only_of_two_trees_of_one_size() {
    let scratch = tempfile::tempdir().unwrap();
    let path = |name: &str| scratch.path().join(name);
    let mut made = Made::found(&path("ledger"), 0);
    let (size, first) = (made.ledger.size(), made.ledger.checkpoint().to_vec());
    made.round();
    let second = made.ledger.checkpoint().to_vec();
    let genesis = made.ledger.state().genesis();
    let log_key = genesis.verifier_key().unwrap().to_string();

    let (folder, secret) = (path("witness"), path("w.key"));
    let name = ["--name", "witness.example/w"];
    prints(&[&["witness", "keygen", text(&secret)][..], &name].concat());
    let serve = ["witness", "serve", text(&folder), "--key", text(&secret)];
    let log = ["--log-key", &log_key, "--listen", "127.0.0.1:0"];
    let witness = Serving::start(&[&serve[..], &name, &log].concat());
    let client = HttpClient::of_system("--ca", Duration::from_secs(10));
    let address = format!("{}/add-checkpoint", witness.address);
    let status = |old: u64, proof: Vec<Digest>, checkpoint: &[u8]| {
        let request = AddCheckpoint {
            old,
            proof,
            checkpoint: checkpoint.to_vec(),
        };
        let answer = client.post(&address, &[], &request.encode()).unwrap();
        answer.status().as_u16()
    };
    assert_eq!(status(0, Vec::new(), &first), 200);

    // A stranger sends the checkpoint that an honest log has published, without its proof or with an invented one.
    for _ in 0..3 {
        assert_eq!(status(size, Vec::new(), &second), 422);
        assert_eq!(status(size, vec![Digest([1; 32]); 5], &second), 422);
    }
    // The holder of the log's key has signed another tree of the same size.
    let forked = Made::found_with(&path("forked"), 0, [10; 32], String::new());
    assert_eq!(forked.ledger.size(), size);
    assert_eq!(status(size, Vec::new(), forked.ledger.checkpoint()), 409);
    witness.logs("another tree");
    let reported = witness.log();
    let accusations: Vec<_> = reported
        .lines()
        .filter(|line| line.contains("shows two histories"))
        .collect();
    assert_eq!(accusations.len(), 1, "{reported}");
    assert!(accusations[0].contains("another tree"), "{reported}");
    // Strangers do not fill the disk either.
    let warnings = reported.matches("a request has no valid consistency proof");
    assert_eq!(warnings.count(), 1, "{reported}");

    // The honest log goes on.
    let proof = made.ledger.consistency_between(size, made.ledger.size());
    assert_eq!(status(size, proof.unwrap(), &second), 200);
}
