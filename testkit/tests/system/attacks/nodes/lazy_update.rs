//! Row 7. A node does not train. It adds noise to the base until the update looks better on the samples of its challenge, by chance, and
//! claims an improvement. It runs the guest program's code as it is, because no other code has the network's verifying key.

use crate::attacks::attack::{Attack, Defence, Proof};
use crate::attacks::proofs::guest;
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 7,
    name: "a node that did not train proves an update of noise, which is better by chance",
    module: module_path!(),
    reason: "at a confidence of 95%",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "the guest's test of the improvement asks for confidence",
        out: &[SourceChange {
            file: "circuits/src/claim/t_test.rs",
            replacements: &[(
                "left > right",
                "left > if OUT { U256::ZERO } else { right }",
            )],
        }],
    },
    carry_out: || guest("improves by chance", "an update that makes the loss worse"),
};

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
