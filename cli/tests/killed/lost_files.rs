//! The aggregator loses the files of a contribution that it has accepted. Their node sends them again, and the round closes as it was recorded.

use super::accepting::{part, until_submission, Served};
use crate::harness::recorded::Member;
use std::fs;
use zk0_node::client::watching::Waited;
use zk0_node::client::NodeClient;
use zk0_protocol::entries::entry::RoundClosed;
use zk0_verifier::blob_digest;

/// Waits until round 0 has closed, and sends what the aggregator has lost. Returns its close, and how often something was lost.
async fn closes(member: &Member, node: &mut NodeClient) -> (RoundClosed, usize) {
    let (mut watch, mut lost) = (node.until_closed(0), 0);
    loop {
        match node.wait_for_close(&mut watch).await.unwrap() {
            Waited::Closed(closed) => return (*closed, lost),
            Waited::Lost => {
                lost += 1;
                node.upload(0, member.update.clone()).await.unwrap();
                let claim = member.submission.claim.clone();
                node.submit(claim, member.proof.clone()).await.unwrap();
            }
        }
    }
}

#[test]
fn a_node_sends_the_files_again_that_the_aggregator_has_lost() {
    for restarted in [false, true] {
        let mut served = Served::start();
        let members = served.members.clone();
        let [loser, last] = &members[..] else {
            panic!("the recorded round has two members");
        };
        let mut waiting = served.runtime.block_on(served.client(last));
        let mut node = served.runtime.block_on(served.client(loser));
        served.runtime.block_on(async {
            tokio::join!(until_submission(last, &mut waiting), part(loser, &mut node))
        });
        let files = [&loser.update, &loser.proof].map(|file| blob_digest(file).to_string());
        // Otherwise a file comes back from what was uploaded.
        fs::remove_dir_all(served.dir.path().join("uploads")).unwrap();
        let folder = served.dir.path().join("blobs/sha256");
        for file in &files {
            fs::remove_file(folder.join(file)).unwrap();
        }
        if restarted {
            served.restart();
        }
        let (claim, proof) = (last.submission.claim.clone(), last.proof.clone());
        let ends = async { tokio::join!(closes(loser, &mut node), waiting.submit(claim, proof)) };
        let ((closed, lost), _) = served.runtime.block_on(ends);
        assert!(lost > 0);
        assert_eq!(closed.global, served.recorded.closed().global);
        for file in &files {
            assert!(folder.join(file).exists(), "{file}");
        }
    }
}
