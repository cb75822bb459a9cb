//! Rounds open and close in time, blobs become public in time, and a killed aggregator goes on after a restart.

use crate::Test;
use ed25519_dalek::SigningKey;
use std::io::Write;
use std::sync::Arc;
use tonic::Code;
use zk0_aggregator::{Aggregator, Config, Polled, RoundStep};
use zk0_audit::Auditor;
use zk0_circuits::Digest;
use zk0_ledger::replay::{replay, Verdict};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::rules::network_rules::{Participation, Scaffold, Strategy};
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

#[test]
fn a_round_in_which_nobody_may_commit_takes_its_time() -> Test {
    let dir = tempfile::tempdir()?;
    let clock = Arc::new(ManualClock::at(START_MS));
    let config = Config {
        rounds: None,
        min_nodes: 0,
    };
    let mut aggregator = found(dir.path(), genesis(), clock.clone(), config)?;
    assert!(matches!(
        aggregator.go_on()?,
        Polled::Did(RoundStep::Open(0))
    ));
    for _ in 0..3 {
        assert!(matches!(aggregator.go_on()?, Polled::Idle(_)));
    }
    clock.advance(COMMIT_MS + 1);
    assert!(matches!(
        aggregator.go_on()?,
        Polled::Did(RoundStep::CloseCommitments(0))
    ));
    Ok(())
}

#[test]
fn no_round_opens_where_no_node_with_a_dataset_may_contribute() -> Test {
    let dir = tempfile::tempdir()?;
    let (there, listed) = (SigningNode::new(1), SigningNode::new(2));
    let mut genesis = genesis();
    genesis.rules.participation = Participation::Listed(vec![listed.id()]);
    let network = genesis.network_id();
    let clock = Arc::new(ManualClock::at(START_MS));
    let config = Config {
        rounds: None,
        min_nodes: 1,
    };
    let mut aggregator = found(dir.path(), genesis, clock, config)?;
    for node in [&there, &listed] {
        aggregator.enrol(node.id(), format!("node {}", node.seed))?;
    }
    for (node, opens) in [(&there, false), (&listed, true)] {
        let registration = borsh::to_vec(&node.registration(&network))?;
        aggregator.register(&registration, &node.list())?;
        let opened = matches!(aggregator.go_on()?, Polled::Did(RoundStep::Open(0)));
        assert_eq!(opened, opens);
    }
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_opens_when_enough_nodes_have_datasets() -> Test {
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let network = Network::start(&[&first, &second], config).await;
    assert_eq!(network.round(None).await.opened, None);
    first.register(&network).await?;
    network.settle().await;
    assert_eq!(network.round(None).await.opened, None);
    second.register(&network).await?;
    network.settle().await;
    let (_, _, entry) = network.opened(network.round(None).await.opened.ok_or("not open")?);
    let Body::RoundOpened(opened) = entry.body else {
        panic!("{entry:?}");
    };
    assert_eq!((opened.round, opened.base), (0, network.genesis.initial));
    assert_eq!(opened.commit_deadline_ms, START_MS + COMMIT_MS);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_closes_early_when_everyone_is_decided() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    for node in [&first, &second] {
        let claim = node.claim(&network).await;
        node.submit(&network, claim, b"no proof").await?;
    }
    network.settle().await;
    let closed = network.round(Some(0)).await.closed.ok_or("not closed")?;
    let (_, _, entry) = network.opened(closed);
    let Body::RoundClosed(closed) = entry.body else {
        panic!("{entry:?}");
    };
    // No contribution was accepted, so the weights stay the same.
    assert_eq!(closed.global, network.genesis.initial);
    assert_eq!(closed.contributors, []);
    // The next round is open and starts from the same weights.
    let (_, _, entry) = network.opened(network.round(None).await.opened.ok_or("not open")?);
    assert!(
        matches!(entry.body, Body::RoundOpened(opened) if opened.round == 1 && opened.base == closed.global)
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_with_an_undecided_node_stays_open_until_its_deadline() -> Test {
    let (network, first, _) = open_round().await;
    committed(&network, &first, 0, 1).await;
    network.clock.advance(COMMIT_MS);
    network.settle().await;
    assert_eq!(network.round(Some(0)).await.commitments_closed, None);
    network.clock.advance(1);
    network.settle().await;
    let round = network.round(Some(0)).await;
    assert!(round.commitments_closed.is_some() && round.randomness.is_some());
    // The time for submissions begins with the randomness.
    network.clock.advance(SUBMIT_MS);
    network.settle().await;
    assert_eq!(network.round(Some(0)).await.closed, None);
    network.clock.advance(1);
    network.settle().await;
    let closed = network.round(Some(0)).await.closed.ok_or("not closed")?;
    let (_, _, entry) = network.opened(closed);
    assert!(matches!(entry.body, Body::RoundClosed(closed) if closed.unanswered == [first.id()]));
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn no_more_rounds_than_asked_for_are_opened() -> Test {
    let (network, ..) = open_round().await;
    for _ in 0..5 {
        network.clock.advance(SUBMIT_MS + 1);
        network.settle().await;
    }
    let opened = network
        .entries()
        .await
        .into_iter()
        .filter(|entry| matches!(entry.body, Body::RoundOpened(_)));
    assert_eq!(opened.count(), 2);
    assert!(network.round(None).await.closed.is_some());
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_update_and_its_proof_are_private_until_the_round_closes() -> Test {
    let (network, first, second) = open_round().await;
    let update = weights(1);
    let blob = blob_digest(&update);
    first.upload(&network, 0, &update).await?;
    refused(
        network.download(blob).await,
        Code::NotFound,
        "names no blob",
    );
    first.commit(&network, 0, &update).await?;
    refused(
        network.download(blob).await,
        Code::PermissionDenied,
        "private until its round closes",
    );
    committed(&network, &second, 0, 2).await;
    let claim = first.claim(&network).await;
    first.submit(&network, claim, b"no proof").await?;
    let proof = blob_digest(b"no proof");
    refused(
        network.download(proof).await,
        Code::PermissionDenied,
        "private until its round closes",
    );
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    assert_eq!(network.download(blob).await?, update);
    assert_eq!(network.download(proof).await?, b"no proof");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn policy_weights_and_leaves_are_public() -> Test {
    let (network, first, _) = open_round().await;
    assert_eq!(network.download(network.genesis.policy).await?, POLICY);
    assert_eq!(
        network.download(network.genesis.initial.blob).await?,
        weights(0)
    );
    let leaves = first.list();
    assert_eq!(network.download(blob_digest(&leaves)).await?, leaves);
    refused(
        network.download(Digest([8; 32])).await,
        Code::NotFound,
        "names no blob",
    );
    let request = zk0_protocol::rpc::federation::DownloadRequest {
        blob: b"../../checkpoint".to_vec(),
        begins: 0,
    };
    refused(
        network.client().await.download(request).await.map(drop),
        Code::InvalidArgument,
        "32 bytes",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_acknowledged_is_lost_when_the_aggregator_is_killed() -> Test {
    let (mut network, first, second) = open_round().await;
    let update = committed(&network, &first, 0, 1).await;
    let committed = first.commit(&network, 0, &update).await?;
    second.upload(&network, 0, &weights(2)).await?;
    network.restart().await;
    // The second node commits to the update that it uploaded before.
    assert_eq!(first.commit(&network, 0, &update).await?, committed);
    second.commit(&network, 0, &weights(2)).await?;
    let claim = first.claim(&network).await;
    let decided = first.submit(&network, claim.clone(), b"no proof").await?;
    let entries = network.entries().await;

    network.restart().await;

    assert_eq!(network.entries().await, entries);
    // After the restart, the aggregator answers the same requests with exactly the same receipts.
    assert_eq!(first.commit(&network, 0, &update).await?, committed);
    let again = first.submit(&network, claim, b"no proof").await?;
    assert_eq!((again.accepted, again.receipt), (false, decided.receipt));
    // The private update stays private.
    let blob = blob_digest(&update);
    refused(
        network.download(blob).await,
        Code::PermissionDenied,
        "private",
    );
    // The round goes on, and the second node's submission is decided.
    let claim = second.claim(&network).await;
    second.submit(&network, claim, b"no proof").await?;
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    assert_eq!(network.download(blob).await?, update);
    Ok(())
}

#[test]
fn a_submission_after_the_deadline_of_an_open_round_is_recorded_as_late() -> Test {
    // This aggregator runs without the timer that would close the round at once.
    let (dir, node) = (tempfile::tempdir()?, SigningNode::new(1));
    let clock = Arc::new(ManualClock::at(START_MS));
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let mut aggregator = found(dir.path(), genesis(), clock.clone(), config)?;
    aggregator.enrol(node.id(), "node".into())?;
    let network = genesis().network_id();
    let registration = borsh::to_vec(&node.registration(&network))?;
    aggregator.register(&registration, &node.list())?;
    assert_eq!(aggregator.step()?, Polled::Did(RoundStep::Open(0)));
    let update = weights(1);
    let request = Signed::new(node.upload_request(&network, 0, &update), &node.key);
    let writer = aggregator.upload(&borsh::to_vec(&request)?)?;
    let mut writer = writer.ok_or("there already")?;
    writer.write(&update)?;
    writer.finish()?;
    let commitment = Signed::new(node.commitment(&network, 0, &update), &node.key);
    aggregator.commit(&borsh::to_vec(&commitment)?)?;
    assert_eq!(
        aggregator.step()?,
        Polled::Did(RoundStep::CloseCommitments(0))
    );
    assert_eq!(aggregator.step()?, Polled::Did(RoundStep::Draw(0)));
    let claim = node.claim_of(aggregator.state().expected_claim(&node.id())?);
    let submission = borsh::to_vec(&node.submission(claim, b"no proof"))?;
    clock.advance(SUBMIT_MS + 5);
    let decided = aggregator.submit(&submission, b"no proof".to_vec())?;
    assert!(matches!(
        decided.rejected.map(|refusal| refusal.code),
        Some(RefusalCode::Late {
            late_ms: 5,
            round: 0,
            ..
        })
    ));
    assert_eq!(aggregator.go_on()?, Polled::Did(RoundStep::Close(0)));
    assert_eq!(aggregator.step()?, Polled::Idle(None));
    let report = replay(dir.path(), None, &mut Auditor::default());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    Ok(())
}

#[test]
fn a_folder_of_another_network_is_not_opened() -> Test {
    let dir = tempfile::tempdir()?;
    let clock = Arc::new(ManualClock::at(START_MS));
    let config = Config {
        rounds: None,
        min_nodes: 1,
    };
    drop(found(dir.path(), genesis(), clock.clone(), config)?);
    let other = Digest([1; 32]);
    let error = Aggregator::open(dir.path(), Some(&other), log_key(), clock.clone(), config).err();
    assert!(error.ok_or("opened")?.to_string().contains("is of network"));
    let stranger = SigningKey::from_bytes(&[1; 32]);
    let error = Aggregator::open(dir.path(), None, stranger, clock.clone(), config).err();
    assert!(error
        .ok_or("opened")?
        .to_string()
        .contains("not the log key"));
    Aggregator::open(
        dir.path(),
        Some(&genesis().network_id()),
        log_key(),
        clock,
        config,
    )?;
    Ok(())
}

#[test]
fn a_network_is_not_founded_on_other_bytes_than_its_genesis_names() -> Test {
    let dir = tempfile::tempdir()?;
    let clock = Arc::new(ManualClock::at(START_MS));
    let other_policy = |out: &mut dyn Write| {
        out.write_all(b"another policy")?;
        Ok(blob_digest(POLICY).0)
    };
    let founding = founding(genesis());
    let founded = founding.found(dir.path(), log_key(), &*clock, 1 << 20, other_policy);
    let error = founded.err().ok_or("founded")?.to_string();
    assert!(error.contains("SHA-256"), "{error}");

    let (dir, clock) = (tempfile::tempdir()?, Arc::new(ManualClock::at(START_MS)));
    let config = Config {
        rounds: None,
        min_nodes: 1,
    };
    let mut program = genesis();
    program.program = vec![0; 31];
    let error = found(dir.path(), program, clock, config).err();
    let error = error.ok_or("opened")?.to_string();
    assert!(error.contains("verifying key"), "{error}");
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_has_lost_its_decision_gets_it_when_the_next_round_is_open() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let claim = first.claim(&network).await;
    let decided = first.submit(&network, claim.clone(), b"no proof").await?;
    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    assert!(network.round(Some(1)).await.opened.is_some());
    let again = first.submit(&network, claim, b"no proof").await?;
    assert_eq!((again.accepted, again.receipt), (false, decided.receipt));
    Ok(())
}

/// A node computes its control variates from its contributions since they began with 0. The aggregator remembers no others.
#[test]
fn a_node_is_shown_its_contributions_as_long_as_scaffold_reads_them() {
    let dir = tempfile::tempdir().unwrap();
    let mut founded = genesis();
    founded.rules.strategy = Strategy::Scaffold(Scaffold {
        steps: 10,
        learning_rate_millionths: 1000,
        restart_rounds: 3,
    });
    let (node, other) = (SigningNode::new(1), SigningNode::new(2));
    let mut operator = Operator::founds(dir.path(), founded, &[&node]);
    let accepted: Vec<_> = (0..3)
        .map(|round| operator.round(&node, round + 1, &[round as u8]))
        .collect();
    let clock = Arc::new(ManualClock::at(operator.time_ms));
    drop(operator);
    let config = Config {
        rounds: None,
        min_nodes: 1,
    };
    let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, config).unwrap();
    let shown = |aggregator: &Aggregator, round, node: Option<&SigningNode>| {
        let published = aggregator.ledger().size();
        node.and_then(|node| aggregator.contribution(round, &node.id(), published))
    };
    for (round, entry) in accepted.iter().enumerate() {
        let round = round as u64;
        assert_eq!(shown(&aggregator, round, Some(&node)), Some(*entry));
        assert_eq!(shown(&aggregator, round, Some(&other)), None);
        assert_eq!(shown(&aggregator, round, None), None);
    }
    // The control variates begin again.
    assert_eq!(aggregator.step().unwrap(), Polled::Did(RoundStep::Open(3)));
    for round in 0..4 {
        assert_eq!(
            shown(&aggregator, round, Some(&node)),
            None,
            "round {round}"
        );
    }
}
