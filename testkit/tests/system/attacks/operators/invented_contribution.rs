//! Row 13. An aggregator records that it accepted a contribution which no proof shows. Its log's signature is right, and the rules of the
//! ledger look into no proof.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use crate::attacks::operators::audited;
use zk0_ledger::log::Ledger;
use zk0_protocol::entries::entry::Body;
use zk0_testkit::aggregator::{both_committed, copy_of, log_key, open_round, START_MS};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 13,
    name: "an aggregator records a contribution that nobody has proven",
    module: module_path!(),
    reason: "was accepted, but this is not an SP1 compressed proof",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "an audit verifies every accepted contribution again",
        out: &[SourceChange {
            file: "audit/src/checks.rs",
            replacements: &[(
                "                    ..failed(&reason)\n",
                "                    ..if OUT { Examined::default() } else { failed(&reason) }\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (network, friend, other) = open_round().await;
    both_committed(&network, &friend, &other).await;
    let proof = b"no proof";
    let submission = friend.submission(friend.claim(&network).await, proof);
    let keep = |aggregator: &mut zk0_aggregator::Aggregator| {
        aggregator.ledger().blobs().put(&proof[..])?;
        Ok(())
    };
    network.service().with(keep).await.unwrap();
    let copy = copy_of(network.dir.path());
    let mut ledger = Ledger::open(copy.path(), None, log_key()).unwrap();
    ledger
        .append(START_MS, Body::ContributionAccepted(submission))
        .unwrap();
    drop(ledger);
    audited(
        copy.path(),
        "the audit states VERIFIED of a contribution without a proof",
    )
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
