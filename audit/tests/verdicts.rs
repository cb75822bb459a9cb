//! An audit states VERIFIED only of what it has checked, with programs and parameters that the auditor knows.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::TempDir;
use zk0_audit::fetch::{fetch, is_fault, WantedBlobs};
use zk0_audit::log_source::source;
use zk0_audit::run::Audit;
use zk0_audit::verified_entries::verified_entries;
use zk0_audit::{Auditor, Depth, TrustedPrograms};
use zk0_circuits::EvalSpec;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::{replay, ReplayReport, SaveOptions, Verdict};
use zk0_ledger::store::Store;
use zk0_ledger::{folder, Ledger};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::Genesis;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;

fn audit(dir: &Path, named: TrustedPrograms) -> ReplayReport {
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
        let report = audit(copy.path(), TrustedPrograms::default());
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

fn reports(report: &ReplayReport, words: &str) -> bool {
    let mut findings = report.findings.iter();
    findings.any(|finding| finding.text.contains(words))
}

#[test]
fn another_program_is_a_fault_unless_the_auditor_names_it() {
    let ours = founded(|_| ());
    let report = audit(ours.path(), TrustedPrograms::default());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    let program = vec![7; 32];
    let theirs = founded(|genesis| genesis.program.clone_from(&program));
    let report = audit(theirs.path(), TrustedPrograms::default());
    assert_eq!(report.verdict, Verdict::Failed);
    assert!(reports(&report, &format!("--program {}", "07".repeat(32))));
    let named = |program| TrustedPrograms {
        programs: [program].into(),
        ..TrustedPrograms::default()
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
        let report = audit(dir.path(), TrustedPrograms::default());
        assert_eq!(report.verdict, expected, "{:?}", report.findings);
        assert!(reports(&report, &format!("--evaluation {digest}")));
        let named = TrustedPrograms {
            evaluations: [digest].into(),
            ..TrustedPrograms::default()
        };
        let report = audit(dir.path(), named);
        assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    }
}

#[test]
fn what_one_audit_names_does_not_go_over_to_the_next() {
    let named = TrustedPrograms {
        programs: [vec![7; 32]].into(),
        ..TrustedPrograms::default()
    };
    let auditor = |named: &TrustedPrograms| Auditor::new(Depth::Full).naming(named.clone());
    let saved = zk0_ledger::replay::Recheck::save(&auditor(&named));
    let blobs = Blobs::at(Path::new(REAL));
    let error = auditor(&TrustedPrograms::default())
        .go_on(&saved, &blobs)
        .err();
    assert!(error.unwrap().contains("--program"));
    assert!(auditor(&named).go_on(&saved, &blobs).is_ok());
}

/// The genesis names the file of the initial weights, and states of it that it holds other numbers. What the guest reads would be other
/// weights than those which the nodes train and the auditors see.
#[test]
fn base_weights_that_hold_other_numbers_are_a_fault() {
    for flipped in [0, 1] {
        let dir = tempfile::tempdir().unwrap();
        let mut genesis = genesis();
        genesis.initial.quantised.0[7] ^= flipped;
        let mut operator = Operator::founds(dir.path(), genesis, &[&SigningNode::new(1)]);
        let opening = operator.ledger.size();
        operator.open();
        drop(operator);
        let report = audit(dir.path(), TrustedPrograms::default());
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

/// An audit of a ledger's folder, or of a copy of one that can be made again.
fn of<'a>(
    state: Option<&Path>,
    fetch_again: Option<&'a dyn Fn() -> anyhow::Result<()>>,
) -> Audit<'a> {
    Audit {
        depth: Depth::Full,
        named: TrustedPrograms::default(),
        network: None,
        threads: None,
        // It is saved at the end alone.
        state_file: state.map(|path| SaveOptions {
            path: path.into(),
            every: Duration::from_secs(3600),
        }),
        seen: None,
        behind_for: Duration::ZERO,
        fetch_again,
        progress: None,
    }
}

fn blobs_of(dir: &Path) -> Vec<PathBuf> {
    let found = fs::read_dir(dir.join("blobs/sha256")).unwrap();
    let blobs: Vec<_> = found.map(|blob| blob.unwrap().path()).collect();
    assert!(blobs.len() > 5, "{blobs:?}");
    blobs
}

/// The blob with one bit changed.
fn flipped(whole: &[u8]) -> Vec<u8> {
    let mut changed = whole.to_vec();
    changed[whole.len() / 2] ^= 1;
    changed
}

/// The file of the initial policy, and those of the first accepted contribution's proof and update.
fn some_blobs(dir: &Path) -> [PathBuf; 3] {
    let (entries, _) = verified_entries(dir).unwrap();
    let policy = entries.iter().find_map(|entry| match &entry.body {
        Body::Genesis(genesis) => Some(genesis.policy),
        _ => None,
    });
    let accepted = entries.iter().find_map(|entry| match &entry.body {
        Body::ContributionAccepted(signed) => Some(&signed.statement),
        _ => None,
    });
    let accepted = accepted.unwrap();
    let update = accepted.claim.terms.update.blob;
    [policy.unwrap(), accepted.proof, update].map(|blob| Blobs::at(dir).path(&blob))
}

#[test]
fn a_blob_that_cannot_be_read_gives_no_verdict_and_none_is_remembered() {
    let (copy, scratch) = (copy_of(Path::new(REAL)), tempfile::tempdir().unwrap());
    let state = scratch.path().join("state");
    let [policy, _, update] = some_blobs(copy.path());
    let audit = of(Some(&state), None);
    for blob in blobs_of(copy.path()) {
        let whole = fs::read(&blob).unwrap();
        fs::remove_file(&blob).unwrap();
        fs::create_dir(&blob).unwrap();
        let error = audit.run(copy.path()).unwrap_err();
        let reported = error.to_string();
        assert!(reported.contains("there is no verdict"), "{reported}");
        assert!(reported.contains(blob.to_str().unwrap()), "{reported}");
        assert!(!is_fault(&error) && !state.exists(), "{reported}");
        if blob == update {
            assert!(verified_entries(copy.path()).is_err());
            // A fault elsewhere is stated all the same.
            let right = fs::read(&policy).unwrap();
            fs::write(&policy, flipped(&right)).unwrap();
            let audited = audit.run(copy.path()).unwrap();
            assert_eq!(audited.verdict, Verdict::Failed, "{:?}", audited.findings);
            assert!(!state.exists());
            fs::write(&policy, right).unwrap();
        }
        fs::remove_dir(&blob).unwrap();
        fs::write(&blob, whole).unwrap();
    }
    let audited = audit.run(copy.path()).unwrap();
    assert_eq!(audited.verdict, Verdict::Verified, "{:?}", audited.findings);
    assert!(state.exists());
}

#[test]
fn a_damaged_blob_of_a_copy_is_fetched_again_before_anybody_judges() {
    let (ledger, mirror) = (copy_of(Path::new(REAL)), tempfile::tempdir().unwrap());
    let from = source(ledger.path().to_str().unwrap(), None).unwrap();
    let again = || -> anyhow::Result<()> {
        let everything = WantedBlobs::Everything;
        Ok(fetch(from.as_ref(), mirror.path(), None, None, everything)?)
    };
    again().unwrap();
    let expected = of(None, Some(&again)).run(mirror.path()).unwrap();
    assert_ne!(expected.verdict, Verdict::Failed, "{:?}", expected.findings);
    for blob in blobs_of(mirror.path()) {
        let whole = fs::read(&blob).unwrap();
        fs::write(&blob, flipped(&whole)).unwrap();
        let audited = of(None, Some(&again)).run(mirror.path()).unwrap();
        assert_eq!(audited, expected);
        assert_eq!(fs::read(&blob).unwrap(), whole);
    }
    // A ledger that is read where it lies cannot be fetched again, so the damage is a fault of it.
    let [policy, proof, _] = some_blobs(mirror.path());
    let whole = fs::read(&proof).unwrap();
    fs::write(&proof, flipped(&whole)).unwrap();
    let audited = of(None, None).run(mirror.path()).unwrap();
    assert_eq!(audited.verdict, Verdict::Failed, "{:?}", audited.findings);
    // A disk that damages the blob again states nothing about the ledger.
    let damages = || -> anyhow::Result<()> { Ok(fs::write(&proof, flipped(&whole))?) };
    let error = of(None, Some(&damages)).run(mirror.path()).unwrap_err();
    assert!(error.to_string().contains("there is no verdict"), "{error}");
    assert!(!is_fault(&error));
    // A fault elsewhere is stated, also when nothing can be fetched.
    let away = || -> anyhow::Result<()> { anyhow::bail!("the log gives no answer") };
    fs::write(&proof, flipped(&whole)).unwrap();
    let error = of(None, Some(&away)).run(mirror.path()).unwrap_err();
    assert!(error.to_string().contains("no answer"), "{error}");
    again().unwrap();
    fs::remove_file(&proof).unwrap();
    fs::write(&policy, b"damaged").unwrap();
    let audited = of(None, Some(&away)).run(mirror.path()).unwrap();
    assert_eq!(audited.verdict, Verdict::Failed, "{:?}", audited.findings);
    // Whoever serves the damaged blob is at fault.
    fs::write(&proof, flipped(&whole)).unwrap();
    let served = ledger
        .path()
        .join("blobs/sha256")
        .join(proof.file_name().unwrap());
    fs::write(served, flipped(&whole)).unwrap();
    let error = of(None, Some(&again)).run(mirror.path()).unwrap_err();
    assert!(is_fault(&error), "{error}");
}

#[test]
fn what_was_found_about_a_missing_or_damaged_blob_is_not_final() {
    let (copy, scratch) = (copy_of(Path::new(REAL)), tempfile::tempdir().unwrap());
    let state = scratch.path().join("state");
    let run = |dir: &Path| of(Some(&state), None).run(dir).unwrap();
    for blob in some_blobs(copy.path()) {
        let whole = fs::read(&blob).unwrap();
        for damaged in [None, Some(flipped(&whole))] {
            match damaged {
                None => fs::remove_file(&blob).unwrap(),
                Some(bytes) => fs::write(&blob, bytes).unwrap(),
            }
            let found = run(copy.path());
            assert_ne!(found.verdict, Verdict::Verified);
            assert_eq!(run(copy.path()), found);
            fs::write(&blob, &whole).unwrap();
            let mended = run(copy.path());
            assert_eq!(mended.verdict, Verdict::Verified, "{:?}", mended.findings);
            fs::remove_file(&state).unwrap();
        }
    }
    // Other faults stay, and so does what the state file knows of the log.
    let without_policy = |dir: &Path| {
        fs::remove_file(Blobs::at(dir).path(&genesis().policy)).unwrap();
        run(dir).verdict
    };
    let theirs = founded(|genesis| genesis.program = vec![7; 32]);
    assert_eq!(without_policy(theirs.path()), Verdict::Failed);
    Blobs::at(theirs.path()).put(POLICY).unwrap();
    assert_eq!(run(theirs.path()).verdict, Verdict::Failed);
    fs::remove_file(&state).unwrap();
    let longer = tempfile::tempdir().unwrap();
    drop(Operator::founds(
        longer.path(),
        genesis(),
        &[&SigningNode::new(1)],
    ));
    assert_eq!(without_policy(longer.path()), Verdict::Incomplete);
    let rolled_back = run(founded(|_| ()).path());
    assert!(reports(&rolled_back.report, "ROLLED BACK"));
}

#[test]
fn an_import_that_was_killed_is_no_fault_of_the_ledger() {
    let (copy, scratch) = (copy_of(Path::new(REAL)), tempfile::tempdir().unwrap());
    let (state, dir) = (scratch.path().join("state"), scratch.path().join("begun"));
    fs::create_dir(&dir).unwrap();
    drop(Store::open(&folder::database(&dir)).unwrap());
    let error = of(None, None).run(&dir).unwrap_err();
    assert!(error.to_string().contains("zk0 ledger import"), "{error}");
    // Where entries were seen before, or signed, they are lost.
    of(Some(&state), None).run(copy.path()).unwrap();
    let audited = of(Some(&state), None).run(&dir).unwrap();
    assert_eq!(audited.verdict, Verdict::Failed);
    fs::copy(folder::checkpoint(copy.path()), folder::checkpoint(&dir)).unwrap();
    let audited = of(None, None).run(&dir).unwrap();
    assert_eq!(audited.verdict, Verdict::Failed);
    // Entries without a checkpoint may be tampering, too. The report states what to do with a copy.
    fs::remove_file(folder::checkpoint(copy.path())).unwrap();
    let audited = of(None, None).run(copy.path()).unwrap();
    assert_eq!(audited.verdict, Verdict::Failed);
    assert!(reports(&audited.report, "zk0 ledger import"));
}
