//! The aggregator loses the files of a contribution that it has accepted. Their node sends them again, and the round closes as it was recorded.

use super::accepting::{part, until_submission, Served};
use crate::harness::drill::Drill;
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
    let drill = Drill::begin("a file of an accepted contribution is lost");
    for restarted in [false, true] {
        let mut served = Served::start();
        let members = served.members.clone();
        let (losers, others): (Vec<_>, Vec<_>) =
            (0..members.len()).partition(|number| members[*number].accepted);
        let others: Vec<_> = losers[1..].iter().chain(&others).copied().collect();
        let loser = &members[losers[0]];
        let mut waiting = Vec::new();
        for number in others {
            let mut node = served.runtime.block_on(served.client(&members[number]));
            let members = members.clone();
            waiting.push(served.runtime.spawn(async move {
                until_submission(&members[number], &mut node).await;
                (number, node)
            }));
        }
        let mut node = served.runtime.block_on(served.client(loser));
        served.runtime.block_on(part(loser, &mut node));
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
        for waiting in waiting {
            let (number, mut node) = served.runtime.block_on(waiting).unwrap();
            let (claim, proof) = (&members[number].submission.claim, &members[number].proof);
            let submitted = node.submit(claim.clone(), proof.clone());
            served.runtime.block_on(submitted).unwrap();
        }
        let (closed, lost) = served.runtime.block_on(closes(loser, &mut node));
        assert!(lost > 0);
        assert_eq!(closed.global, served.recorded.closed().global);
        for file in &files {
            assert!(folder.join(file).exists(), "{file}");
        }
    }
    drill.passed();
}
