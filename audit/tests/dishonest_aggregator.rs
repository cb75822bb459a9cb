//! The audit of a network that an aggregator has run: it confirms what is right, and it finds what the aggregator made up.

use zk0_audit::Auditor;
use zk0_circuits::Digest;
use zk0_ledger::log::Ledger;
use zk0_ledger::replay::{replay, Verdict};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::evaluation_set::{list_bytes, DrawnLeaf};
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

type Test = Result<(), Box<dyn std::error::Error>>;

#[tokio::test(flavor = "multi_thread")]
async fn the_history_replays_and_refusals_are_found_to_be_right() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let claim = first.claim(&network).await;
    first.submit(&network, claim, b"no proof").await?;
    let mut claim = second.claim(&network).await;
    claim.terms.challenge = Digest([1; 32]);
    second.submit(&network, claim, b"no proof").await?;
    network.settle().await;
    let mut auditor = Auditor::default();
    let report = replay(
        network.dir.path(),
        Some(&network.genesis.network_id()),
        &mut auditor,
    );
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    let checked = auditor.checked();
    assert_eq!(
        (checked.datasets, checked.refusals, checked.not_checked),
        (2, 2, 0)
    );

    // Without the evidence a refusal cannot be judged, and the report states it.
    let proof = network
        .dir
        .path()
        .join("blobs/sha256")
        .join(blob_digest(b"no proof").to_string());
    std::fs::remove_file(proof)?;
    let mut auditor = Auditor::default();
    let report = replay(network.dir.path(), None, &mut auditor);
    assert_eq!(report.verdict, Verdict::Incomplete);
    assert_eq!(
        (auditor.checked().refusals, auditor.checked().not_checked),
        (1, 1)
    );
    assert!(report
        .findings
        .iter()
        .any(|finding| finding.text.contains("not at hand")));
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_audit_finds_what_a_dishonest_aggregator_records() -> Test {
    // The ledger's own rules do not look into proofs and blobs, so anyone who holds the log's key can write these entries.
    let cases: [(&str, fn(Signed<Submission>) -> Body); 3] = [
        ("was accepted, but", Body::ContributionAccepted),
        (
            "verification states: this is not an SP1 compressed proof",
            |submission| Body::ContributionRejected {
                submission,
                reason: RefusalCode::InvalidProof,
            },
        ),
        (
            "verification states: this is not an SP1 compressed proof",
            |submission| Body::ContributionRejected {
                submission,
                reason: RefusalCode::MalformedUpdate,
            },
        ),
    ];
    for (words, body) in cases {
        let (network, first, second) = open_round().await;
        both_committed(&network, &first, &second).await;
        let submission = first.submission(first.claim(&network).await, b"no proof");
        network
            .service()
            .with(move |aggregator| {
                aggregator.ledger().blobs().put(b"no proof")?;
                Ok(())
            })
            .await?;
        let copy = copy_of(network.dir.path());
        let mut ledger = Ledger::open(copy.path(), None, log_key())?;
        ledger.append(START_MS, body(submission))?;
        drop(ledger);
        let report = replay(copy.path(), None, &mut Auditor::default());
        assert_eq!(report.verdict, Verdict::Failed);
        let found = report
            .findings
            .iter()
            .any(|finding| finding.text.contains(words));
        assert!(found, "{words}: {:?}", report.findings);
    }
    Ok(())
}

/// A node chooses the frames that its claims are about, and the aggregator helps it.
#[test]
fn an_audit_finds_a_dataset_with_frames_that_were_not_drawn() {
    let node = SigningNode::new(1);
    let dir = tempfile::tempdir().unwrap();
    let mut operator = operator::Operator::founds(dir.path(), genesis(), &[&node]);
    let mut registration = node.registration(operator.state().network()).statement;
    registration.episodes[0].frames = 1000;
    let drawn = list(&registration, &node.leaves());
    let chosen: Vec<_> = (0..10)
        .zip(node.leaves())
        .map(|(frame, leaf)| DrawnLeaf { frame, leaf })
        .collect();
    let mut audited = |operator: &mut operator::Operator, list: Vec<u8>| {
        operator.ledger.blobs().put(&list).unwrap();
        registration.leaves = blob_digest(&list);
        let signed = Signed::new(registration.clone(), &node.key);
        operator.append(Body::DatasetCommitted(signed));
        replay(dir.path(), None, &mut Auditor::default())
    };
    let report = audited(&mut operator, drawn);
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    let report = audited(&mut operator, list_bytes(&chosen));
    assert_eq!(report.verdict, Verdict::Failed);
    let found = report.findings.iter();
    let found = found.filter(|finding| finding.text.contains("nobody chooses the frames"));
    assert_eq!(found.count(), 1, "{:?}", report.findings);
}
