//! Row 14. An aggregator shows two histories: one to its witnesses, and another one, with an entry replaced, to whom it wants to deceive. It
//! asks the witnesses to cosign the other one as well.

use crate::attacks::attack::{over_the_network, Attack, Defence, Outcome, Proof};
use std::sync::Arc;
use zk0_aggregator::publish::cosigning::CosigningError;
use zk0_testkit::aggregator::witnesses::{cosigned, ledger, log_verifier, three};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 14,
    name: "an aggregator has its witnesses cosign a second history",
    module: module_path!(),
    reason: "does not show that the tree of 7 entries continues the one of 5 entries",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "a witness cosigns what continues the checkpoint that it cosigned before, and nothing else",
        out: &[SourceChange {
            file: "protocol/src/tlog/witness.rs",
            replacements: &[(
                "        .map_err(|error| inconsistent(&error.to_string())),\n",
                "        .or_else(|error| if OUT { Ok(()) } else { Err(inconsistent(&error.to_string())) }),\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (_witnesses, policy) = three().await;
    let dirs = [0, 1].map(|_| tempfile::tempdir().unwrap());
    let shown = Arc::new(ledger(dirs[0].path(), &[1, 2, 3, 4]));
    let note = cosigned(&policy, &shown).await.unwrap();
    policy.open(&note, &log_verifier()).unwrap();
    let other = Arc::new(ledger(dirs[1].path(), &[1, 2, 9, 4, 5, 6]));
    match cosigned(&policy, &other).await {
        Ok(note) => {
            let opened = policy.open(&note, &log_verifier()).unwrap();
            Outcome::Succeeded(format!(
                "{} witnesses have cosigned two histories",
                opened.cosigners.len()
            ))
        }
        Err(CosigningError::NoQuorum { refused, .. }) => Outcome::Refused(refused.join("; ")),
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
