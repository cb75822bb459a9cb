//! Who may not commit may not upload, and gets no address of the bucket.

use super::uploads::signed;
use crate::Test;
use std::fs;
use tonic::{Code, Status};
use zk0_aggregator::Config;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{Leaving, Proposal, Signed, Vote};
use zk0_protocol::Body;
use zk0_testkit::aggregator::*;

async fn record(network: &Network, body: &Body) -> Result<(), Status> {
    let request = network.recording(body);
    network.client().await.record(request).await.map(drop)
}

/// The node begins an upload, and asks how much of it has come.
async fn uploads_nothing(network: &Network, node: &SigningNode, code: Code, words: &str) {
    let (update, before) = (weights(9), network.uploads());
    refused(node.upload(network, 0, &update).await, code, words);
    let request = signed(network, node, &update);
    refused(node.upload_info(network, &request).await, code, words);
    refused(node.stored(network, &request).await, code, words);
    assert_eq!(network.uploads(), before);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_revoked_node_uploads_nothing() -> Test {
    let (governor, first, second) = (
        SigningNode::new(GOVERNOR),
        SigningNode::new(1),
        SigningNode::new(2),
    );
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&first, &second], config).await;
    let proposal = Proposal {
        network: network.genesis.network_id(),
        number: 0,
        proposer: governor.id(),
        title: "without the second".into(),
        text: String::new(),
        action: Action::Revoke(second.id()),
    };
    let of = proposal.digest();
    record(
        &network,
        &Body::Proposed(Signed::new(proposal, &governor.key)),
    )
    .await?;
    let vote = Vote {
        network: network.genesis.network_id(),
        proposal: 0,
        of,
        voter: governor.id(),
        ballot: Ballot::For,
    };
    record(&network, &Body::Voted(Signed::new(vote, &governor.key))).await?;
    network.clock.advance(VOTING_MS + 1);
    network.settle().await;
    first.register(&network).await?;
    network.settle().await;
    uploads_nothing(&network, &second, Code::PermissionDenied, "is revoked").await;
    committed(&network, &first, 0, 1).await;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_has_left_uploads_nothing() -> Test {
    let (network, _, second) = open_round().await;
    let leaving = Leaving {
        network: network.genesis.network_id(),
        node: second.id(),
        round: 1,
    };
    record(&network, &Body::NodeLeft(Signed::new(leaving, &second.key))).await?;
    uploads_nothing(
        &network,
        &second,
        Code::PermissionDenied,
        "may not take part",
    )
    .await;
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_uploaded_after_the_commitments_have_closed() -> Test {
    let (network, first, second) = open_round().await;
    committed(&network, &first, 0, 1).await;
    network.drawn().await;
    uploads_nothing(&network, &second, Code::FailedPrecondition, "are closed").await;
    Ok(())
}

/// A node that was killed after its commitment uploads its update again, and goes on.
#[tokio::test(flavor = "multi_thread")]
async fn a_node_that_has_committed_is_told_that_its_update_is_here_and_uploads_no_other() -> Test {
    let (mut network, first, _) = open_round().await;
    let update = committed(&network, &first, 0, 1).await;
    let request = signed(&network, &first, &update);
    uploads_nothing(&network, &first, Code::AlreadyExists, "already committed").await;
    for closed in [false, true] {
        if closed {
            network.drawn().await;
            network.restart().await;
            fs::remove_dir_all(network.dir.path().join("uploads"))?;
        }
        let held = network.uploads();
        let info = first.upload_info(&network, &request).await?;
        assert_eq!((info.held, &*info.address), (update.len() as u64, ""));
        first.upload(&network, 0, &update).await?;
        first
            .go_on(&network, &request, &update, update.len())
            .await?;
        first.commit(&network, 0, &update).await?;
        assert_eq!(network.uploads(), held);
    }
    Ok(())
}
