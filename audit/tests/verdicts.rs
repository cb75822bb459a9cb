//! An audit says VERIFIED only of what it has checked, with programs and parameters that the auditor knows.

#[path = "../../aggregator/tests/harness/mod.rs"]
mod harness;

use harness::operator::Operator;
use harness::*;
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use zk0_audit::verified_entries::verified_entries;
use zk0_audit::{Auditor, Depth, Named};
use zk0_circuits::EvalSpec;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::{replay, Report, Verdict};
use zk0_ledger::Ledger;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::Genesis;

fn audit(dir: &Path, named: Named) -> Report {
    replay(dir, None, &mut Auditor::new(Depth::Full).naming(named))
}

#[test]
fn without_any_one_of_its_blobs_a_ledger_is_not_verified() {
    let (entries, report) = verified_entries(Path::new(REAL)).unwrap();
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    let accepted: Vec<_> = entries
        .iter()
        .filter_map(|entry| match &entry.body {
            Body::ContributionAccepted(signed) => Some(&signed.statement),
            _ => None,
        })
        .flat_map(|statement| {
            let terms = &statement.claim.terms;
            [statement.proof, terms.update.blob, terms.base.blob]
        })
        .collect();
    let mut verdicts = Vec::new();
    for blob in fs::read_dir(Path::new(REAL).join("blobs/sha256")).unwrap() {
        let name = blob.unwrap().file_name().into_string().unwrap();
        let digest = name.parse().unwrap();
        let copy = copy_of(Path::new(REAL));
        fs::remove_file(Blobs::at(copy.path()).path(&digest)).unwrap();
        let report = audit(copy.path(), Named::default());
        // What counted in a closed round must be there, and what it started from. Anything else may be missing, but then the audit is
        // not complete.
        let expected = match accepted.contains(&digest) {
            true => Verdict::Failed,
            false => Verdict::Incomplete,
        };
        assert_eq!(report.verdict, expected, "{name}: {:?}", report.findings);
        verdicts.push(expected);
    }
    assert!(verdicts.contains(&Verdict::Failed) && verdicts.contains(&Verdict::Incomplete));
}

/// A ledger of a network that was founded like this.
fn founded(change: impl FnOnce(&mut Genesis)) -> TempDir {
    let mut genesis = genesis();
    change(&mut genesis);
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    blobs.put(&weights(0)).unwrap();
    blobs.put(POLICY).unwrap();
    drop(Ledger::create(dir.path(), genesis, log_key(), START_MS).unwrap());
    dir
}

fn says(report: &Report, words: &str) -> bool {
    let mut findings = report.findings.iter();
    findings.any(|finding| finding.text.contains(words))
}

#[test]
fn another_program_is_a_fault_unless_the_auditor_names_it() {
    let ours = founded(|_| ());
    let report = audit(ours.path(), Named::default());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    let program = vec![7; 32];
    let theirs = founded(|genesis| genesis.program.clone_from(&program));
    let report = audit(theirs.path(), Named::default());
    assert_eq!(report.verdict, Verdict::Failed);
    assert!(says(&report, &format!("--program {}", "07".repeat(32))));
    let named = |program| Named {
        programs: [program].into(),
        ..Named::default()
    };
    let report = audit(theirs.path(), named(vec![8; 32]));
    assert_eq!(report.verdict, Verdict::Failed);
    let report = audit(theirs.path(), named(program));
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
}

#[test]
fn an_evaluation_of_others_is_not_called_verified_unless_the_auditor_names_it() {
    let other = |change: fn(&mut EvalSpec)| {
        let mut digest = None;
        let dir = founded(|genesis| {
            let mut spec = EvalSpec::decode(&genesis.evaluation).unwrap();
            change(&mut spec);
            genesis.evaluation = spec.encode();
            digest = Some(spec.digest());
        });
        (dir, digest.unwrap())
    };
    let ranges = other(|spec| spec.layers[0].gate -= 1);
    let frequencies = other(|spec| spec.time_frequencies[0] += 1);
    for ((dir, digest), expected) in [
        (ranges, Verdict::Incomplete),
        (frequencies, Verdict::Failed),
    ] {
        let report = audit(dir.path(), Named::default());
        assert_eq!(report.verdict, expected, "{:?}", report.findings);
        assert!(says(&report, &format!("--evaluation {digest}")));
        let named = Named {
            evaluations: [digest].into(),
            ..Named::default()
        };
        let report = audit(dir.path(), named);
        assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    }
}

#[test]
fn what_one_audit_names_does_not_go_over_to_the_next() {
    let named = Named {
        programs: [vec![7; 32]].into(),
        ..Named::default()
    };
    let auditor = |named: &Named| Auditor::new(Depth::Full).naming(named.clone());
    let saved = zk0_ledger::replay::Recheck::save(&auditor(&named));
    let blobs = Blobs::at(Path::new(REAL));
    let error = auditor(&Named::default()).go_on(&saved, &blobs).err();
    assert!(error.unwrap().contains("--program"));
    assert!(auditor(&named).go_on(&saved, &blobs).is_ok());
}

/// The genesis names the file of the initial weights, and says of it that it holds other numbers. What the guest reads would be other
/// weights than those which the nodes train and the auditors see.
#[test]
fn base_weights_that_hold_other_numbers_are_a_fault() {
    for flipped in [0, 1] {
        let dir = tempfile::tempdir().unwrap();
        let mut genesis = genesis();
        genesis.initial.quantised.0[7] ^= flipped;
        let mut operator = Operator::founds(dir.path(), genesis, &[&Node::new(1)]);
        let opening = operator.ledger.size();
        operator.open();
        drop(operator);
        let report = audit(dir.path(), Named::default());
        let mut findings = report.findings.iter();
        let found = findings.any(|finding| {
            finding.index == Some(opening) && finding.text.contains("the base weights: ")
        });
        assert_eq!(found, flipped == 1, "{:?}", report.findings);
        let expected = match flipped {
            0 => Verdict::Verified,
            _ => Verdict::Failed,
        };
        assert_eq!(report.verdict, expected, "{:?}", report.findings);
    }
}
