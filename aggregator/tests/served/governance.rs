//! What members state over the network becomes rules. The aggregator finds out that an accepted contribution is false.

use super::verified_again;
use crate::Test;
use std::sync::Arc;
use tonic::{Code, Status};
use zk0_aggregator::serve::service::ServeError;
use zk0_aggregator::{Aggregator, Config, Polled, RoundStep, Service};
use zk0_circuits::Digest;
use zk0_ledger::log::Ledger;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::entries::entry::{Body, Contributor, RandomnessDrawn, RoundClosed};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{
    Dispute, Evidence, KeyRotation, KeyTakeover, Proposal, Signed, Vote,
};
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rules::network_rules::Participation;
use zk0_protocol::{RefusalCode, Rules};
use zk0_testkit::aggregator::*;

async fn record(network: &Network, body: &Body) -> Result<u64, Status> {
    let request = network.recording(body);
    let receipt = network.client().await.record(request).await?.into_inner();
    let (index, _, entry) = network.opened(receipt);
    assert_eq!(&entry.body, body);
    Ok(index)
}

fn proposal(network: &Network, by: &SigningNode, number: u64, action: Action) -> Body {
    let proposal = Proposal {
        network: network.genesis.network_id(),
        number,
        proposer: by.id(),
        title: "smaller rounds".into(),
        text: String::new(),
        action,
    };
    Body::Proposed(Signed::new(proposal, &by.key))
}

fn vote(network: &Network, by: &SigningNode, on: &Body, ballot: Ballot) -> Body {
    let Body::Proposed(proposed) = on else {
        panic!("not a proposal: {on:?}");
    };
    let vote = Vote {
        network: network.genesis.network_id(),
        proposal: proposed.statement.number,
        of: proposed.statement.digest(),
        voter: by.id(),
        ballot,
    };
    Body::Voted(Signed::new(vote, &by.key))
}

fn config() -> Config {
    Config {
        rounds: Some(3),
        min_nodes: 2,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_vote_changes_the_next_round() -> Test {
    let (governor, first, second) = (
        SigningNode::new(GOVERNOR),
        SigningNode::new(1),
        SigningNode::new(2),
    );
    let mut network = Network::start(&[&first, &second], config()).await;
    for node in [&first, &second] {
        node.register(&network).await?;
    }
    network.settle().await;
    let rules = Rules {
        participation: Participation::Listed(vec![first.id()]),
        ..network.genesis.rules.clone()
    };
    let action = Action::ChangeRules(Box::new(rules.clone()));
    let proposed = proposal(&network, &governor, 0, action.clone());
    let index = record(&network, &proposed).await?;
    // After a restart, the aggregator answers the same request with the index of the entry that exists already.
    network.restart().await;
    assert_eq!(record(&network, &proposed).await?, index);
    let stranger = proposal(&network, &first, 1, action);
    refused(
        record(&network, &stranger).await,
        Code::FailedPrecondition,
        "may not vote here",
    );
    record(&network, &vote(&network, &governor, &proposed, Ballot::For)).await?;
    let info = network
        .client()
        .await
        .get_governance(proto::GetGovernanceRequest {})
        .await?;
    let info = info.into_inner();
    assert_eq!(info.next_proposal, 1);
    assert_eq!(
        (info.proposals[0].for_it, info.proposals[0].electorate),
        (1, 1)
    );
    assert_eq!(
        borsh::from_slice::<Rules>(&info.rules)?,
        network.genesis.rules
    );

    // The voting ends in the middle of the round. The new rules take effect with the next round.
    network.clock.advance(VOTING_MS + 1);
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_none());
    network.clock.advance(SUBMIT_MS);
    network.settle().await;
    let bodies: Vec<_> = network
        .entries()
        .await
        .into_iter()
        .map(|entry| entry.body)
        .collect();
    let at = |what: fn(&Body) -> bool| bodies.iter().rposition(what).unwrap();
    let closed = at(|body| matches!(body, Body::RoundClosed(closed) if closed.round == 0));
    let settled = at(
        |body| matches!(body, Body::ProposalSettled(settled) if settled.outcome == Outcome::Executed),
    );
    let opened = at(|body| matches!(body, Body::RoundOpened(opened) if opened.round == 1));
    assert!(closed < settled && settled < opened);
    assert!(matches!(&bodies[opened], Body::RoundOpened(opened) if opened.rules == rules));
    // The aggregator tells a node whether it is invited, before the node trains.
    let asked = |node: &SigningNode| proto::GetRoundRequest {
        round: Some(1),
        node: node.id().0.to_vec(),
    };
    for (node, invited) in [(&first, true), (&second, false)] {
        let info = network
            .client()
            .await
            .get_round(asked(node))
            .await?
            .into_inner();
        assert_eq!(info.invited, invited);
    }
    refused(
        second.upload(&network, 1, &weights(3)).await,
        Code::PermissionDenied,
        "not among those",
    );
    refused(
        second.commit(&network, 1, &weights(3)).await,
        Code::PermissionDenied,
        "not among those",
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn only_what_members_may_say_is_recorded() -> Test {
    let network = Network::start(&[], config()).await;
    let enrolled = Body::NodeEnrolled(NodeEnrolled {
        node: SigningNode::new(5).id(),
        name: "by myself".into(),
    });
    refused(
        record(&network, &enrolled).await,
        Code::InvalidArgument,
        "neither a proposal",
    );
    for bytes in [vec![], vec![255], vec![0; (64 << 10) + 1]] {
        let request = proto::RecordRequest {
            statement: Some(Statement::Body(bytes)),
            leaves: Vec::new(),
        };
        let result = network.client().await.record(request).await;
        refused(result, Code::InvalidArgument, "record");
    }
    assert_eq!(network.entries().await.len(), 1);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_goes_on_under_its_next_key() -> Test {
    let (first, second, next) = (
        SigningNode::new(1),
        SigningNode::new(2),
        SigningNode::new(7),
    );
    let network = Network::start(&[&first, &second], config()).await;
    for node in [&first, &second] {
        node.register(&network).await?;
    }
    network.settle().await;
    let rotation = KeyRotation {
        network: network.genesis.network_id(),
        node: first.id(),
        with: next.id(),
    };
    let body = Body::KeyRotated {
        rotation: Signed::new(rotation, &first.key),
        takeover: Signed::new(KeyTakeover { rotation }, &next.key),
    };
    record(&network, &body).await?;
    refused(
        first.upload(&network, 0, &weights(1)).await,
        Code::PermissionDenied,
        "not enrolled",
    );
    next.upload(&network, 0, &weights(1)).await?;
    Ok(())
}

/// Makes a ledger whose aggregator accepted a false proof of node 1 in round 0, and has been honest since.
fn with_a_false_contribution(
) -> Result<(tempfile::TempDir, Aggregator, u64), Box<dyn std::error::Error>> {
    let (dir, clock) = (tempfile::tempdir()?, Arc::new(ManualClock::at(START_MS)));
    let node = SigningNode::new(1);
    let open =
        |clock: Arc<ManualClock>| Aggregator::open(dir.path(), None, log_key(), clock, config());
    let mut aggregator = found(
        dir.path(),
        genesis(),
        clock.clone(),
        Config {
            rounds: Some(1),
            min_nodes: 1,
        },
    )?;
    let network = genesis().network_id();
    aggregator.enrol(node.id(), "the only one".into())?;
    aggregator.register(&borsh::to_vec(&node.registration(&network))?, &node.list())?;
    assert_eq!(aggregator.step()?, Polled::Did(RoundStep::Open(0)));
    drop(aggregator);
    let mut ledger = Ledger::open(dir.path(), None, log_key())?;
    let update = weights(1);
    for blob in [&update[..], b"no proof"] {
        ledger.blobs().put(blob)?;
    }
    let commitment = node.commitment(&network, 0, &update);
    ledger.append(
        START_MS,
        Body::UpdateCommitted(Signed::new(commitment, &node.key)),
    )?;
    let closing = ledger.state().next_commitments_closed(START_MS);
    ledger.append(
        START_MS,
        Body::CommitmentsClosed(closing.ok_or("a node may commit")?),
    )?;
    let closing = ledger.state().round().and_then(|round| round.closing);
    let drawn = RandomnessDrawn {
        round: 0,
        drawing: Drawing::LogVrf(ledger.vrf(&closing.ok_or("not closed")?.commitments)),
    };
    ledger.append(START_MS, Body::RandomnessDrawn(drawn))?;
    let claim = node.claim_of(ledger.state().expected_claim(&node.id())?);
    let submission = node.submission(claim, b"no proof");
    let accepted = ledger
        .append(START_MS, Body::ContributionAccepted(submission))?
        .index;
    let contributors = ledger.state().contributors();
    assert!(matches!(
        contributors[..],
        [Contributor { credits: 1.., .. }]
    ));
    let closed = RoundClosed {
        round: 0,
        global: digest(&update),
        contributors,
        unanswered: vec![],
        evaluated: None,
    };
    ledger.append(START_MS, Body::RoundClosed(closed))?;
    drop(ledger);
    let aggregator = open(clock)?;
    Ok((dir, aggregator, accepted))
}

#[test]
fn a_disputed_contribution_is_verified_again() -> Test {
    let (_dir, mut aggregator, accepted) = with_a_false_contribution()?;
    let node = SigningNode::new(1);
    let earned = |aggregator: &Aggregator| aggregator.state().node(&node.id()).unwrap().credits;
    assert!(earned(&aggregator) > 0);
    let upheld = verified_again(&mut aggregator, accepted)?;
    assert_eq!(upheld, Some(RefusalCode::MalformedProof));
    assert_eq!(earned(&aggregator), 0);
    let standing = aggregator.state().node(&node.id()).unwrap().standing;
    assert_eq!(standing, Standing::Suspended);
    // No node is ready for another round.
    assert_eq!(aggregator.step()?, Polled::Idle(None));
    Ok(())
}

#[test]
fn a_dispute_by_what_a_document_says_waits_for_a_vote() -> Test {
    let (_dir, mut aggregator, accepted) = with_a_false_contribution()?;
    let governor = SigningNode::new(GOVERNOR);
    let dispute = Dispute {
        network: *aggregator.state().network(),
        disputer: governor.id(),
        contribution: accepted,
        evidence: Evidence::Document(Digest([1; 32])),
    };
    let body = Body::Disputed(Signed::new(dispute, &governor.key));
    aggregator.tell(&borsh::to_vec(&body)?)?;
    assert_eq!(aggregator.state().disputes().len(), 1);
    assert_eq!(aggregator.state().undecided(), None);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_served_without_the_witnesses_that_the_rules_name() -> Test {
    let mut genesis = genesis();
    let witness = zk0_protocol::tlog::cosigner::Cosigner::new("witness.example/w", log_key())?;
    let line = format!("witness W {} http://127.0.0.1:1\nquorum W\n", witness.key());
    genesis.rules.witness_policy = line;
    let dir = tempfile::tempdir()?;
    let aggregator = found(
        dir.path(),
        genesis,
        Arc::new(ManualClock::at(START_MS)),
        config(),
    )?;
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await?;
    let served = Service::new(aggregator).serve(listener, std::future::ready(()));
    assert!(matches!(
        served.await,
        Err(ServeError::OtherWitnesses { .. })
    ));
    Ok(())
}
