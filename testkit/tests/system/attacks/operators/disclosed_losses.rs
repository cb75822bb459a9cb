//! Row 15. The network's genesis lets nobody know the losses. A contribution states them all the same: with a client that its aggregator
//! wrote, for example.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use crate::attacks::scene::{commit, near_base, proving_network, submitted};
use zk0_circuits::{Disclosure, Losses};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 15,
    name:
        "a contribution discloses the losses on private data in a network that keeps them private",
    module: module_path!(),
    reason: "disclosure of the claim is not what the ledger determines: it is losses, but nothing on the ledger",
    proof: Proof::SeenLater,
    defence: Defence {
        check: "a claim discloses what the rules allow, and no more",
        out: &[SourceChange {
            file: "circuits/src/claim/public_values.rs",
            replacements: &[(
                "        same(\"disclosure\", &self.losses.disclosure(), &disclosure)\n",
                "        if OUT {
            return Ok(());
        }
        same(\"disclosure\", &self.losses.disclosure(), &disclosure)\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let private = |genesis: &mut zk0_protocol::Genesis| {
        genesis.rules.disclosure = Disclosure::Nothing;
    };
    let (network, node, _) = proving_network(private).await;
    commit(&network, &node, &near_base(1)).await;
    let claim = node.claim(&network).await;
    let Losses::Disclosed { before, after, .. } = claim.losses else {
        panic!("the claim discloses nothing");
    };
    let won = format!("the round counts a claim that states the losses {before} and {after}");
    submitted(&network, &node, claim, &won).await
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
