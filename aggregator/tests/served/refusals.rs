//! The aggregator tells strangers, cheats and late nodes over the network why it refuses them. These tests also show which refusals
//! the ledger records.

use crate::Test;
use tonic::Code;
use zk0_aggregator::Config;
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::evaluation_set::{list_bytes, DrawnLeaf};
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::federation::RecordRequest;
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

#[tokio::test(flavor = "multi_thread")]
async fn an_unknown_node_is_turned_away_everywhere() -> Test {
    let (network, first, _) = open_round().await;
    let stranger = SigningNode::new(9);
    let update = weights(5);
    let before = network.entries().await.len();
    refused(
        stranger.register(&network).await,
        Code::PermissionDenied,
        "not enrolled",
    );
    refused(
        stranger.upload(&network, 0, &update).await,
        Code::PermissionDenied,
        "not enrolled",
    );
    refused(
        stranger.commit(&network, 0, &update).await,
        Code::PermissionDenied,
        "not enrolled",
    );
    committed(&network, &first, 0, 1).await;
    let mut claim = first.claim(&network).await;
    claim.terms.node = stranger.id();
    refused(
        stranger.submit(&network, claim, b"proof").await,
        Code::PermissionDenied,
        "not enrolled",
    );
    // A commitment, the closing of the commitments, and the randomness.
    assert_eq!(network.entries().await.len(), before + 3);
    assert_eq!(network.uploads(), 1);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_signature_by_another_key_is_no_signature() -> Test {
    let (network, first, second) = open_round().await;
    let update = both_committed(&network, &first, &second).await;
    network.drawn().await;
    let before = network.entries().await.len();
    let forger = &second.key;
    let registration = Signed::new(
        first.registration(&network.genesis.network_id()).statement,
        forger,
    );
    let result = first
        .register_as(&network, &registration, &first.leaves())
        .await;
    refused(result, Code::Unauthenticated, "signature");
    let upload = Signed::new(
        first.upload_request(&network.genesis.network_id(), 0, &update),
        forger,
    );
    refused(
        first.upload_as(&network, &upload, &update).await,
        Code::Unauthenticated,
        "signature",
    );
    let commitment = Signed::new(
        first.commitment(&network.genesis.network_id(), 0, &update),
        forger,
    );
    refused(
        first.commit_as(&network, &commitment).await,
        Code::Unauthenticated,
        "signature",
    );
    let mut submission = first.submission(first.claim(&network).await, b"proof");
    submission.signature[5] ^= 1;
    let result = first.submit_as(&network, &submission, b"proof").await;
    refused(result, Code::Unauthenticated, "signature");
    assert_eq!(network.entries().await.len(), before);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn statements_for_another_network_or_round_are_turned_away() -> Test {
    let (network, first, _) = open_round().await;
    let elsewhere = Digest([99; 32]);
    let update = weights(1);
    let mut registration = first.registration(&network.genesis.network_id()).statement;
    registration.network = elsewhere;
    let registration = Signed::new(registration, &first.key);
    let result = first
        .register_as(&network, &registration, &first.leaves())
        .await;
    refused(result, Code::FailedPrecondition, "network");
    let mut upload = first.upload_request(&network.genesis.network_id(), 0, &update);
    upload.network = elsewhere;
    let upload = Signed::new(upload, &first.key);
    refused(
        first.upload_as(&network, &upload, &update).await,
        Code::FailedPrecondition,
        "network",
    );
    refused(
        first.upload(&network, 1, &update).await,
        Code::FailedPrecondition,
        "round 1",
    );
    first.upload(&network, 0, &update).await?;
    let mut commitment = first.commitment(&network.genesis.network_id(), 0, &update);
    commitment.network = elsewhere;
    let commitment = Signed::new(commitment, &first.key);
    refused(
        first.commit_as(&network, &commitment).await,
        Code::FailedPrecondition,
        "network",
    );
    refused(
        first.commit(&network, 1, &update).await,
        Code::FailedPrecondition,
        "round 1",
    );
    first.commit(&network, 0, &update).await?;
    network.drawn().await;
    // Anyone can replay what the node signed for another network or round. Such a replay must not use up the node's one submission.
    let before = network.entries().await.len();
    let mut claim = first.claim(&network).await;
    claim.terms.network = elsewhere;
    refused(
        first.submit(&network, claim, b"proof").await,
        Code::FailedPrecondition,
        "network",
    );
    let mut claim = first.claim(&network).await;
    claim.terms.round = 7;
    refused(
        first.submit(&network, claim, b"proof").await,
        Code::FailedPrecondition,
        "round 7",
    );
    assert_eq!(network.entries().await.len(), before);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_commitment_after_its_deadline_is_late() -> Test {
    let (network, first, _) = open_round().await;
    let update = weights(1);
    first.upload(&network, 0, &update).await?;
    network.clock.advance(COMMIT_MS + 1);
    // It is late, or the commitments are closed already.
    let status = first.commit(&network, 0, &update).await.unwrap_err();
    assert_eq!(status.code(), Code::FailedPrecondition);
    let reported = ["1 ms after the deadline", "are closed", "round 0, but"];
    let why = status.message();
    assert!(
        reported.iter().any(|reported| why.contains(reported)),
        "{why}"
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_claim_before_the_randomness_is_turned_away() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let claim = first.claim(&network).await;
    // The same claim in another network of the same nodes, in which the commitments are still open.
    let (other, first, _) = open_round().await;
    committed(&other, &first, 0, 1).await;
    let before = other.entries().await.len();
    refused(
        first.submit(&other, claim, b"proof").await,
        Code::FailedPrecondition,
        "the randomness of round 0 is not drawn yet",
    );
    assert_eq!(other.entries().await.len(), before);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_commitment_at_its_deadline_is_in_time() -> Test {
    let (network, first, _) = open_round().await;
    let update = weights(1);
    first.upload(&network, 0, &update).await?;
    network.clock.advance(COMMIT_MS);
    first.commit(&network, 0, &update).await?;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_submission_after_the_round_is_turned_away() -> Test {
    let (network, first, _) = open_round().await;
    committed(&network, &first, 0, 1).await;
    let claim = first.claim(&network).await;
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    refused(
        first.submit(&network, claim, b"proof").await,
        Code::FailedPrecondition,
        "round 0",
    );
    assert!(network.round(Some(0)).await.closed.is_some());
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_commitment_is_refused_the_same_one_is_answered_again() -> Test {
    let (network, first, _) = open_round().await;
    let update = committed(&network, &first, 0, 1).await;
    let before = network.entries().await.len();
    let (once, again) = (
        first.commit(&network, 0, &update).await?,
        first.commit(&network, 0, &update).await?,
    );
    assert_eq!(once, again);
    let other = weights(2);
    refused(
        first.upload(&network, 0, &other).await,
        Code::AlreadyExists,
        "already committed",
    );
    refused(
        first.commit(&network, 0, &other).await,
        Code::AlreadyExists,
        "already committed",
    );
    assert_eq!(network.entries().await.len(), before);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn the_challenge_follows_from_what_the_receipts_show() -> Test {
    let (network, first, second) = open_round().await;
    let update = both_committed(&network, &first, &second).await;
    network.drawn().await;
    let (_, _, entry) = network.opened(first.commit(&network, 0, &update).await?);
    let Body::UpdateCommitted(signed) = entry.body else {
        panic!("{entry:?}");
    };
    let round = network.round(Some(0)).await;
    let (_, _, entry) = network.opened(round.randomness.ok_or("not drawn")?);
    let Body::RandomnessDrawn(drawn) = entry.body else {
        panic!("{entry:?}");
    };
    let challenge = zk0_circuits::claim::challenge::challenge(
        &network.genesis.network_id(),
        0,
        &first.id(),
        &zk0_protocol::challenge::closing::commitment(&signed.statement),
        &drawn.drawing.value().ok_or("no value")?,
    );
    assert_eq!(first.claim(&network).await.terms.challenge, challenge);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_copied_update_is_refused() -> Test {
    let (network, first, second) = open_round().await;
    let update = committed(&network, &first, 0, 1).await;
    second.upload(&network, 0, &update).await?;
    refused(
        second.commit(&network, 0, &update).await,
        Code::AlreadyExists,
        "already committed by node",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_update_has_to_be_uploaded_by_the_node_that_commits_to_it() -> Test {
    let (network, first, second) = open_round().await;
    let update = weights(1);
    refused(
        first.commit(&network, 0, &update).await,
        Code::FailedPrecondition,
        "not uploaded",
    );
    second.upload(&network, 0, &update).await?;
    refused(
        first.commit(&network, 0, &update).await,
        Code::FailedPrecondition,
        "not uploaded",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_submission_without_a_commitment_is_turned_away() -> Test {
    let (network, first, second) = open_round().await;
    committed(&network, &first, 0, 1).await;
    let mut claim = first.claim(&network).await;
    claim.terms.node = second.id();
    refused(
        second.submit(&network, claim, b"proof").await,
        Code::FailedPrecondition,
        "not committed",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_proof_that_is_none_is_recorded_and_kept() -> Test {
    let (network, first, _) = open_round().await;
    committed(&network, &first, 0, 1).await;
    let claim = first.claim(&network).await;
    let reply = first.submit(&network, claim, b"no proof at all").await?;
    assert!(!reply.accepted);
    assert!(
        reason(&reply).contains("not an SP1 compressed proof"),
        "{}",
        reason(&reply)
    );
    let (_, _, entry) = network.opened(reply.receipt.ok_or("no receipt")?);
    let Body::ContributionRejected {
        submission,
        reason: RefusalCode::MalformedProof,
    } = entry.body
    else {
        panic!("{entry:?}");
    };
    let blobs = network.dir.path().join("blobs/sha256");
    assert_eq!(
        std::fs::read(blobs.join(submission.statement.proof.to_string()))?,
        b"no proof at all"
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_claim_that_the_ledger_contradicts_is_recorded() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let mut claim = first.claim(&network).await;
    claim.terms.eval_samples = 1;
    let reply = first.submit(&network, claim, b"proof").await?;
    assert!(
        reason(&reply).contains("eval_samples of the claim")
            && reply.detail.contains("it is 1, but 4"),
        "{}",
        reason(&reply)
    );
    assert!(matches!(
        network.last().await,
        Body::ContributionRejected {
            reason: RefusalCode::Binding(_),
            ..
        }
    ));
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_submission_is_refused_the_same_one_is_answered_again() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let claim = first.claim(&network).await;
    let once = first.submit(&network, claim.clone(), b"no proof").await?;
    let before = network.entries().await.len();
    let again = first.submit(&network, claim.clone(), b"no proof").await?;
    assert_eq!(once.receipt, again.receipt);
    // The ledger holds no details, so only the first answer has them.
    assert!(!once.detail.is_empty() && again.detail.is_empty());
    let other = first.submit(&network, claim, b"another proof").await;
    refused(other, Code::AlreadyExists, "already submitted");
    assert_eq!(network.entries().await.len(), before);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn other_bytes_than_the_node_signed_leave_no_trace() -> Test {
    // Somebody between the node and the aggregator swaps the proof. This must not cost the node its submission.
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let submission = first.submission(first.claim(&network).await, b"proof");
    let before = network.entries().await.len();
    let result = first.submit_as(&network, &submission, b"swapped").await;
    refused(result, Code::InvalidArgument, "the node signed");
    assert_eq!(network.entries().await.len(), before);
    let reply = first.submit_as(&network, &submission, b"proof").await?;
    assert!(reply.receipt.is_some());
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn datasets_are_checked_before_they_are_recorded() -> Test {
    let first = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&first], config).await;
    let sign = |leaves: &[Digest], samples: u64| {
        let mut registration = first.registration(&network.genesis.network_id()).statement;
        registration.dataset.root = zk0_circuits::vm::merkle::root(leaves);
        registration.dataset.samples = samples;
        registration.leaves = blob_digest(&list(&registration, leaves));
        Signed::new(registration, &first.key)
    };
    let before = network.entries().await.len();
    // The node lists the first frames of its recording, which the hash of the episodes does not draw.
    let mut longer = first.registration(&network.genesis.network_id()).statement;
    longer.episodes[0].frames = 1000;
    let chosen: Vec<_> = (0..10)
        .zip(first.leaves())
        .map(|(frame, leaf)| DrawnLeaf { frame, leaf })
        .collect();
    let chosen = list_bytes(&chosen);
    longer.leaves = blob_digest(&chosen);
    let longer = Signed::new(longer, &first.key);
    let request = first.registering(&network, &longer, chosen);
    let result = network.client().await.record(request).await;
    refused(
        result.map(drop),
        Code::InvalidArgument,
        "nobody chooses the frames",
    );
    let mut more = first.registration(&network.genesis.network_id()).statement;
    more.evaluation_frames = 11;
    let more = Signed::new(more, &first.key);
    let result = first.register_as(&network, &more, &first.leaves()).await;
    refused(
        result,
        Code::InvalidArgument,
        "draws 11 frames, but the rules ask for 10",
    );
    let mut doubled = first.leaves();
    doubled[3] = doubled[7];
    let result = first
        .register_as(&network, &sign(&doubled, 10), &doubled)
        .await;
    refused(
        result,
        Code::InvalidArgument,
        "9 distinct samples, but the dataset commitment counts 10",
    );
    let few = &first.leaves()[..3];
    let result = first.register_as(&network, &sign(few, 3), few).await;
    refused(result, Code::InvalidArgument, "at least 4");
    let result = first
        .register_as(&network, &sign(&first.leaves(), 11), &first.leaves())
        .await;
    refused(result, Code::InvalidArgument, "counts 11 samples");
    let result = first
        .register_as(
            &network,
            &first.registration(&network.genesis.network_id()),
            &doubled,
        )
        .await;
    refused(result, Code::InvalidArgument, "the registration names");
    let mut other_root = first.registration(&network.genesis.network_id()).statement;
    other_root.dataset.root = Digest([5; 32]);
    let other_root = Signed::new(other_root, &first.key);
    let result = first
        .register_as(&network, &other_root, &first.leaves())
        .await;
    refused(result, Code::InvalidArgument, "root");
    assert_eq!(network.entries().await.len(), before);
    let receipt = first.register(&network).await?;
    assert_eq!(first.register(&network).await?, receipt);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn bytes_that_are_no_statement_are_named() -> Test {
    let (network, first, _) = open_round().await;
    let mut client = network.client().await;
    let commitment = first.commitment(&network.genesis.network_id(), 0, &weights(1));
    let commitment = Body::UpdateCommitted(Signed::new(commitment, &first.key));
    // A statement with one more byte is refused.
    let longer = [&borsh::to_vec(&commitment)?[..], &[0]].concat();
    for bytes in [vec![], vec![4; 100], vec![0; 20_000], longer] {
        for (statement, words) in [
            (Statement::Body(bytes.clone()), "valid entry to record"),
            (Statement::Enrolment(bytes), "valid enrolment"),
        ] {
            let request = RecordRequest {
                statement: Some(statement),
                leaves: Vec::new(),
            };
            refused(client.record(request).await, Code::InvalidArgument, words);
        }
    }
    let nothing = client.record(RecordRequest::default()).await;
    refused(nothing, Code::InvalidArgument, "no statement");
    // Frames belong to a dataset.
    let framed = client.record(with_leaves(&commitment, first.list())).await;
    refused(framed, Code::InvalidArgument, "with nothing else");
    Ok(())
}
