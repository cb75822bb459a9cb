//! Row 5. A node takes a proof that somebody else has made, and submits it as the proof of its own claim.

use crate::attacks::attack::{over_the_network, Attack, Outcome, Proof};
use crate::attacks::scene::{commit, near_base, proving_network, submitted, PROOF_OF_ANY_CLAIM};

pub const ATTACK: Attack = Attack {
    number: 5,
    name: "a node submits the proof of another node as its own",
    module: module_path!(),
    reason: "the SP1 proof does not prove this claim: its public values differ",
    proof: Proof::NotNeeded,
    defence: PROOF_OF_ANY_CLAIM,
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (network, thief, _) = proving_network(|_| ()).await;
    commit(&network, &thief, &near_base(1)).await;
    let claim = thief.claim(&network).await;
    let won = "the round counts a contribution of the thief, with a proof that a node of another network made";
    submitted(&network, &thief, claim, won).await
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
