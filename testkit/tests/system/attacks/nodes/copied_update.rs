//! Row 6. A node downloads the update of another one while the round is open, changes a bit of it, and commits to it as its own.

use crate::attacks::attack::{answered, over_the_network, Attack, Defence, Outcome, Proof};
use crate::attacks::scene::{commit, near_base};
use zk0_testkit::aggregator::open_round;
use zk0_testkit::changed_copy::SourceChange;
use zk0_verifier::blob_digest;

pub const ATTACK: Attack = Attack {
    number: 6,
    name:
        "a node downloads another one's update in the open round, changes a bit, and commits to it",
    module: module_path!(),
    reason: "is private until its round closes",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "an update stays private until its round has closed",
        out: &[SourceChange {
            file: "aggregator/src/round/aggregator.rs",
            replacements: &[(
                "BlobAccess::Public => Ok(",
                "BlobAccess::HeldBack if OUT => Ok(self.ledger.blobs().clone()),
            BlobAccess::Public => Ok(",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (network, honest, thief) = open_round().await;
    let update = near_base(1);
    commit(&network, &honest, &update).await;
    // The ledger is public, and the commitment names the update.
    let mut copy = match network.download(blob_digest(&update)).await {
        Ok(copy) => copy,
        Err(status) => return Outcome::Refused(status.message().into()),
    };
    *copy.last_mut().unwrap() ^= 1;
    thief.upload(&network, 0, &copy).await.unwrap();
    let receipt = thief.commit(&network, 0, &copy).await;
    answered(receipt, |_| {
        "the ledger has its commitment to what another node has trained, but for one bit".into()
    })
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
