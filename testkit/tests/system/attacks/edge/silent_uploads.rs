//! Row 16. A node begins an upload and falls silent, so that its connection, its file and its place are held for as long as it likes.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_stream::wrappers::ReceiverStream;
use zk0_aggregator::{Config, Limits};
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_protocol::rpc::federation::UploadChunk;
use zk0_testkit::aggregator::{weights, Network, SigningNode};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 16,
    name: "a node begins an upload, falls silent, and holds what it has taken",
    module: module_path!(),
    reason: "no data came for more than 2000 ms",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "a stream that is silent for too long ends",
        out: &[SourceChange {
            file: "aggregator/src/serve/uploading.rs",
            replacements: &[(
                "        let silent = Instant::now() + silence;\n",
                "        let allowed = if OUT { upload } else { silence };
        let silent = Instant::now() + allowed;\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

/// How long a stream may be silent in this network, and how long the attacker is.
const ALLOWED: Duration = Duration::from_secs(2);
const SILENT: Duration = Duration::from_secs(15);

async fn carry_out() -> Outcome {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let limits = Limits {
        silence: ALLOWED,
        ..Limits::default()
    };
    let network = Network::start_with(&[&node], config, limits).await;
    node.register(&network).await.unwrap();
    network.settle().await;
    let update = weights(1);
    let request = node.upload_request(&network.genesis.network_id(), 0, &update);
    let request = Signed::new(request, &node.key);
    let statement = borsh::to_vec(&request).unwrap();
    let (sender, receiver) = mpsc::channel(2);
    for part in [Part::Request(statement), Part::Data(update[..100].to_vec())] {
        let part = Some(part);
        sender.send(UploadChunk { part, begins: 0 }).await.unwrap();
    }
    let mut client = network.client().await;
    let upload = client.upload(node.uploading(&network, &request, ReceiverStream::new(receiver)));
    match timeout(SILENT, upload).await {
        Ok(Err(status)) => {
            // What has come stays, and the node can go on.
            node.go_on(&network, &request, &update, 100).await.unwrap();
            Outcome::Refused(status.message().into())
        }
        Ok(Ok(_)) => panic!("an upload without its end was taken"),
        Err(_) => Outcome::Succeeded(format!(
            "after {SILENT:?} of silence, the connection and the node's place are still taken"
        )),
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
