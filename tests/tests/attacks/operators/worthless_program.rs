//! Row 12. Somebody founds a network whose guest program proves nothing, and shows an auditor that its ledger is in order.

use crate::attack::{Attack, Defence, Outcome, Proof};
use crate::harness::operator::Operator;
use crate::harness::{genesis, Node};
use zk0_audit::Auditor;
use zk0_ledger::replay::{replay, Verdict};
use zk0_tests::changed_copy::Change;

pub const ATTACK: Attack = Attack {
    number: 12,
    name: "a founder has a network audited whose guest program proves nothing",
    module: module_path!(),
    reason: "what another program proves is unknown",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "an auditor compares the program with its own, or with one that it names",
        out: &[Change {
            file: "audit/src/checks.rs",
            replacements: &[(
                "if key == own || named.programs.contains(key) {",
                "if key == own || named.programs.contains(key) || OUT {",
            )],
        }],
    },
    carry_out,
};

fn carry_out() -> Outcome {
    let mut genesis = genesis();
    genesis.program = vec![2; 32];
    let dir = tempfile::tempdir().unwrap();
    drop(Operator::founds(dir.path(), genesis, &[&Node::new(1)]));
    let report = replay(dir.path(), None, &mut Auditor::default());
    match report.verdict {
        Verdict::Verified => {
            Outcome::Succeeded("the audit says VERIFIED of a network that proves nothing".into())
        }
        _ => {
            let found: Vec<_> = report.findings.into_iter().map(|one| one.text).collect();
            Outcome::Refused(found.join("; "))
        }
    }
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
