//! `zk0 aggregator serve --keep-rounds`: the running aggregator prunes when a round has closed.

use crate::harness::serving::Serving;
use crate::harness::{ends, printed, prints, text, zk0};
use std::fs;
use zk0_ledger::Blobs;
use zk0_protocol::Body;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::{genesis, weights, SigningNode};
use zk0_testkit::until;

#[test]
fn a_served_ledger_keeps_so_many_rounds() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, key) = (scratch.path().join("ledger"), scratch.path().join("key"));
    fs::write(&key, "2a".repeat(32)).unwrap();
    let mut founded = genesis();
    // Rounds without a contribution are soon over.
    founded.rules.commit_window_ms = 50;
    let node = SigningNode::new(1);
    let mut operator = Operator::founds(&dir, founded, &[&node]);
    let unnamed = operator.ledger.blobs().put(b"about to be named").unwrap();
    let mut updates = Vec::new();
    for round in 0..3 {
        operator.open();
        let update = weights(100 + round);
        let submission = operator.submission_of(&node, &update, &[round as u8]);
        operator.append(Body::ContributionAccepted(submission));
        operator.close(200 + round);
        updates.push(operator.ledger.blobs().put(&update).unwrap());
    }
    drop(operator);
    let serve = ["aggregator", "serve", text(&dir), "--key", text(&key)];
    let keeping = |rounds| {
        [
            "--listen",
            "127.0.0.1:0",
            "--min-nodes",
            "0",
            "--keep-rounds",
            rounds,
        ]
    };
    ends(2, zk0(&[&serve[..], &keeping("0")].concat()));
    let mut aggregator = Serving::start(&[&serve[..], &keeping("2")].concat());
    let blobs = Blobs::at(&dir);
    until("the updates go", || {
        !updates.iter().any(|update| blobs.contains(update))
    });
    aggregator.logs("old updates are deleted");
    assert!(aggregator.terminate().success());
    assert!(blobs.contains(&unnamed));
    let prune = ["ledger", "prune", text(&dir), "--keep-rounds", "2"];
    let reported = prints(&[&prune[..], &["--dry-run"]].concat());
    let (left, signed) = ("1 file that no entry names", "sign  ");
    assert!(reported.contains(left), "{reported}");
    assert!(
        !reported.contains("updates of") && !reported.contains(signed),
        "{reported}"
    );
    let audit = printed(&zk0(&["audit", "replay", text(&dir)]).output().unwrap());
    assert!(
        audit.contains("has pruned the updates of rounds 0 to 2"),
        "{audit}"
    );
}
