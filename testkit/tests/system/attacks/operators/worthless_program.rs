//! Row 12. Somebody founds a network whose guest program proves nothing, and shows an auditor that its ledger is in order.

use crate::attacks::attack::{Attack, Defence, Outcome, Proof};
use crate::attacks::operators::audited;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::{genesis, SigningNode};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 12,
    name: "a founder has a network audited whose guest program proves nothing",
    module: module_path!(),
    reason: "what another program proves is unknown",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "an auditor compares the program with its own, or with one that it names",
        out: &[SourceChange {
            file: "audit/src/checks.rs",
            replacements: &[(
                "if is_carried(genesis.mode, key) || named.programs.contains(key) {",
                "if is_carried(genesis.mode, key) || named.programs.contains(key) || OUT {",
            )],
        }],
    },
    carry_out,
};

fn carry_out() -> Outcome {
    let mut genesis = genesis();
    genesis.program = vec![2; 32];
    let dir = tempfile::tempdir().unwrap();
    drop(Operator::founds(
        dir.path(),
        genesis,
        &[&SigningNode::new(1)],
    ));
    audited(
        dir.path(),
        "the audit states VERIFIED of a network that proves nothing",
    )
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
