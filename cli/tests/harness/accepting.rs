//! An operator who accepts contributions without a proof. The rules of the ledger allow it; only an audit would find it.

use super::network::LocalNetwork;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use zk0::keys;
use zk0_circuits::{Losses, NodeId, WeightsDigest};
use zk0_ledger::Ledger;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::entries::entry::{RandomnessDrawn, RoundClosed};
use zk0_protocol::entries::signed::{Submission, UpdateCommitment};
use zk0_protocol::{Body, Signed};

/// The network's ledger, to write to while no aggregator serves it.
pub fn ledger(network: &LocalNetwork) -> Ledger {
    let key = keys::read(Path::new(&network.path("log.key"))).unwrap();
    Ledger::open(Path::new(&network.path("ledger")), None, key).unwrap()
}

/// The time of the next entry.
pub fn now_ms() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    now.as_millis() as u64
}

/// The operator accepts these updates of the nodes with these files of keys in a round of its own, and takes `result` as what they combine to.
/// Returns the number of the round.
pub fn accept(
    network: &LocalNetwork,
    updates: &[(&str, WeightsDigest)],
    result: WeightsDigest,
) -> u64 {
    let mut ledger = ledger(network);
    let now = now_ms();
    let close = |ledger: &mut Ledger, global| {
        let round = ledger.state().round().unwrap();
        let closed = RoundClosed {
            round: round.number(),
            global,
            contributors: ledger.state().contributors(),
            unanswered: ledger.state().unanswered(),
            evaluated: None,
        };
        ledger.append(now, Body::RoundClosed(closed)).unwrap();
    };
    // The aggregator may have ended before the round of the refused update was closed, or after it opened the next one.
    if let Some(round) = ledger.state().round() {
        if !round.commits.is_empty() {
            let base = round.opened.base;
            close(&mut ledger, base);
        }
    }
    if ledger.state().round().is_none() {
        let opening = ledger.state().next_opening(now).unwrap();
        ledger.append(now, Body::RoundOpened(opening)).unwrap();
    }
    let round = ledger.state().round().unwrap().number();
    let key = |file: &str| keys::read(Path::new(&network.path(file))).unwrap();
    for (file, update) in updates {
        let (state, key) = (ledger.state(), key(file));
        let node = NodeId(key.verifying_key().to_bytes());
        let commitment = UpdateCommitment {
            network: *state.network(),
            round,
            node,
            dataset_root: state.node(&node).unwrap().dataset.unwrap().commitment.root,
            update: *update,
            eval_samples: state.rules().min_eval_samples,
        };
        let commitment = Body::UpdateCommitted(Signed::new(commitment, &key));
        ledger.append(now, commitment).unwrap();
    }
    let closed = ledger.state().next_commitments_closed(now).unwrap();
    ledger.append(now, Body::CommitmentsClosed(closed)).unwrap();
    let closing = ledger.state().round().unwrap().closing.unwrap();
    let drawing = Drawing::LogVrf(ledger.vrf(&closing.commitments));
    let drawn = RandomnessDrawn { round, drawing };
    ledger.append(now, Body::RandomnessDrawn(drawn)).unwrap();
    for (file, _) in updates {
        let key = key(file);
        let node = NodeId(key.verifying_key().to_bytes());
        let claim = ledger.state().expected_claim(&node).unwrap();
        let claim = claim.with(Losses::Disclosed {
            before: 1000,
            after: 500,
            elements: 100,
        });
        let proof = ledger.blobs().put(b"no proof").unwrap();
        let submission = Signed::new(Submission { claim, proof }, &key);
        let accepted = Body::ContributionAccepted(submission);
        ledger.append(now, accepted).unwrap();
    }
    close(&mut ledger, result);
    round
}
