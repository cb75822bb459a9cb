//! Row 12. A node runs a guest program of its own, which checks nothing, and submits the proof of what that states.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use crate::attacks::scene::{commit, near_base, proving_network, submitted};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 12,
    name: "a node submits a valid proof of another program than the network's",
    module: module_path!(),
    reason: "the SP1 proof is of another program than this network's",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "a proof has the verifying key of the program in force",
        out: &[SourceChange {
            file: "verifier/src/contribution.rs",
            replacements: &[(
                "        check_proof_of(&terms.program, self.parts()?.sp1, self.claim())\n",
                "    let checked = check_proof_of(&terms.program, self.parts()?.sp1, self.claim());
    match checked {
        Err(Refusal { code: RefusalCode::OtherProgram, .. }) if OUT => Ok(()),
        checked => checked,
    }\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let other = vec![2; 32];
    let (network, cheat, _) = proving_network(|genesis| genesis.program = other).await;
    commit(&network, &cheat, &near_base(1)).await;
    let claim = cheat.claim(&network).await;
    let won = "the round counts a contribution whose proof is of a program that nobody agreed on";
    submitted(&network, &cheat, claim, won).await
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
