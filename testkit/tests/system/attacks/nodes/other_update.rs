//! Row 4. A node commits to the update that its proof is about, and uploads another one under its name.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use crate::attacks::scene::{near_base, proving_network, submitted};
use zk0_protocol::entries::signed::Signed;
use zk0_testkit::changed_copy::SourceChange;
use zk0_verifier::blob_digest;

pub const ATTACK: Attack = Attack {
    number: 4,
    name: "a node proves one update and uploads another one under its name",
    module: module_path!(),
    reason: "but the node committed to",
    proof: Proof::SeenLater,
    defence: Defence {
        check:
            "the uploaded bytes have the digest of the claim, and hold the numbers that were proven",
        out: &[
            SourceChange {
                file: "ledger/src/blobs.rs",
                replacements: &[(
                    "if expected.0 == actual {",
                    "if expected.0 == actual || OUT {",
                )],
            },
            SourceChange {
                file: "verifier/src/update.rs",
                replacements: &[
                    (
                        "if actual == *expected {",
                        "if actual == *expected || OUT {",
                    ),
                    (
                        "if actual == claimed.quantised {",
                        "if actual == claimed.quantised || OUT {",
                    ),
                ],
            },
        ],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (network, cheat, _) = proving_network(|_| ()).await;
    let (proven, other) = (near_base(1), near_base(2));
    let request = cheat.upload_request(&network.genesis.network_id(), 0, &proven);
    let request = Signed::new(request, &cheat.key);
    if let Err(status) = cheat.upload_as(&network, &request, &other).await {
        return Outcome::Refused(status.message().into());
    }
    if let Err(status) = cheat.commit(&network, 0, &proven).await {
        return Outcome::Refused(status.message().into());
    }
    let claim = cheat.claim(&network).await;
    let won = format!(
        "the round counts weights with SHA-256 {}, and the proof is about {}",
        blob_digest(&other),
        blob_digest(&proven)
    );
    submitted(&network, &cheat, claim, &won).await
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
