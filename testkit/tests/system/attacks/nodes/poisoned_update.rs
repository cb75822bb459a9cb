//! Row 9. A node whose claim is true and proven sends an update that moves the weights further than the rules allow. The contribution is
//! that of a real demo, with its real proof; the rules allow steps of at most one basis point.

use crate::attacks::attack::{Attack, Defence, Outcome, Proof};
use crate::real_ledger::{accepted, ledger_copy, with_rules};
use zk0_testkit::changed_copy::SourceChange;
use zk0_verifier::{authenticate, verify};

pub const ATTACK: Attack = Attack {
    number: 9,
    name: "a node sends a proven update that moves the weights further than the rules allow",
    module: module_path!(),
    reason: "the norm of the update's difference from its base is",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "the norm of an update's difference from its base is bounded",
        out: &[SourceChange {
            file: "verifier/src/norm.rs",
            replacements: &[(
                "if difference <= norm * U256::from(limit * limit) {",
                "if OUT || difference <= norm * U256::from(limit * limit) {",
            )],
        }],
    },
    carry_out,
};

fn carry_out() -> Outcome {
    let real = accepted(ledger_copy().path());
    let state = with_rules(&real.state, |rules| rules.max_update_norm_bps = 1);
    let contribution = real.contribution;
    let node = contribution.submission.statement.claim.terms.node;
    let context = state.claim_context(&node);
    let verified = authenticate(contribution.submission, contribution.proof, &context)
        .and_then(|authentic| verify(&authentic, &contribution.weights, &context, real.time_ms));
    match verified {
        Ok(verified) => Outcome::Succeeded(format!(
            "the contribution of node {} counts in full",
            verified.node()
        )),
        Err(refusal) => Outcome::Refused(refusal.to_string()),
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
