//! Row 3. A node shows an improvement on other weights than those that the round started from: on weights that are easy to improve on.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use crate::attacks::scene::{commit, near_base, proving_network, submitted};
use zk0_testkit::aggregator::{digest, weights};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 3,
    name: "a node claims an improvement on weights that it chose as a base",
    module: module_path!(),
    reason: "base.blob of the claim is not what the ledger determines",
    proof: Proof::SeenLater,
    defence: Defence {
        check: "a claim is about the base of the ledger's open round",
        out: &[
            SourceChange {
                file: "circuits/src/claim/terms.rs",
                replacements: &[
                    (
                        "same(\"base.blob\", &self.base.blob, &base.blob)?;",
                        "let base = if OUT { &self.base } else { base };
        same(\"base.blob\", &self.base.blob, &base.blob)?;",
                    ),
                ],
            },
            SourceChange {
                file: "verifier/src/update.rs",
                replacements: &[(
                    "        check_blob(base, &claim.terms.base.blob)?;\n",
                    "        check_blob(base, &claim.terms.base.blob).or_else(|why| if OUT { Ok(()) } else { Err(why) })?;\n",
                )],
            },
        ],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (network, cheat, _) = proving_network(|_| ()).await;
    commit(&network, &cheat, &near_base(1)).await;
    let mut claim = cheat.claim(&network).await;
    claim.terms.base = digest(&weights(7));
    let won = format!(
        "the round counts an improvement on {}, which is not its base",
        claim.terms.base.blob
    );
    submitted(&network, &cheat, claim, &won).await
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
