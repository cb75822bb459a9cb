//! Light and full audits, with one thread or several, in one run or in parts, find the same.

use rocksdb::DB;
use std::collections::BTreeMap;
use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Duration;
use zk0_audit::account::{CheckKind, Checked, SkipReason};
use zk0_audit::{Auditor, Depth};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::{
    replay, replay_with, ReplayOptions, ReplayReport, SaveOptions, SavedReplay, Severity, Verdict,
};
use zk0_ledger::store::Store;
use zk0_ledger::{folder, Ledger};
use zk0_protocol::entries::entry::{Body, DisputeResolved, RoundClosed};
use zk0_protocol::entries::signed::{Dispute, Evidence, Signed};
use zk0_protocol::{Entry, RefusalCode};
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;

type Test = Result<(), Box<dyn std::error::Error>>;

fn audit(dir: &Path, depth: Depth, threads: usize) -> (ReplayReport, Checked) {
    let mut auditor = Auditor::with_threads(depth, NonZeroUsize::new(threads).unwrap());
    let options = ReplayOptions {
        threads: NonZeroUsize::new(threads),
        ..ReplayOptions::default()
    };
    let report = replay_with(dir, options, &mut auditor);
    (report, auditor.checked())
}

fn entries(dir: &Path) -> Vec<Entry> {
    let store = Store::open_read_only(&folder::database(dir)).unwrap();
    (0..store.size().unwrap())
        .map(|index| Entry::decode(&store.entry(index).unwrap().unwrap()).unwrap())
        .collect()
}

/// The blobs that the entries name as proofs.
fn proofs(dir: &Path) -> Vec<PathBuf> {
    let proof = |entry: Entry| match entry.body {
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            Some(Blobs::at(dir).path(&submission.statement.proof))
        }
        _ => None,
    };
    entries(dir).into_iter().filter_map(proof).collect()
}

/// The proof of the first accepted contribution.
fn accepted_proof(dir: &Path) -> PathBuf {
    let proof = |entry: Entry| match entry.body {
        Body::ContributionAccepted(submission) => Some(submission.statement.proof),
        _ => None,
    };
    let proof = entries(dir).into_iter().find_map(proof).unwrap();
    Blobs::at(dir).path(&proof)
}

fn blobs(dir: &Path) -> Vec<PathBuf> {
    let mut blobs: Vec<_> = fs::read_dir(dir.join("blobs/sha256"))
        .unwrap()
        .map(|found| found.unwrap().path())
        .collect();
    blobs.sort();
    blobs
}

fn notes(report: &ReplayReport) -> Vec<&str> {
    let findings = report.findings.iter();
    findings
        .filter(|finding| finding.severity == Severity::NotChecked)
        .map(|finding| finding.text.as_str())
        .collect()
}

#[test]
fn a_light_audit_verifies_proofs_and_reads_no_weights() {
    let dir = copy_of(Path::new(REAL));
    let (full, everything) = audit(dir.path(), Depth::Full, 2);
    assert_eq!(full.verdict, Verdict::Verified, "{:?}", full.findings);
    assert!(everything.proofs >= 1 && everything.updates >= 1 && everything.averages >= 1);
    let (light, checked) = audit(dir.path(), Depth::Light, 2);
    assert_eq!(light.verdict, Verdict::Incomplete, "{:?}", light.findings);
    assert_eq!(checked.proofs, everything.proofs);
    assert_eq!((checked.updates, checked.datasets), (0, 0));
    assert!(checked.not_checked >= 5);
    // The report has one line for each kind of check that was left out.
    let mut kinds: Vec<_> = notes(&light)
        .iter()
        .map(|text| text.split(": ").next())
        .collect();
    kinds.sort();
    kinds.dedup();
    assert_eq!(kinds.len(), notes(&light).len());
    assert!(notes(&light).len() <= 8);
    // A light audit finds the same when all blobs but the proofs are damaged or missing. A full audit fails when they are damaged.
    let proofs = proofs(dir.path());
    let blobs = blobs(dir.path());
    for blob in blobs.iter().filter(|blob| !proofs.contains(blob)) {
        fs::write(blob, b"changed").unwrap();
    }
    assert_eq!(audit(dir.path(), Depth::Light, 2).0, light);
    assert_eq!(audit(dir.path(), Depth::Full, 2).0.verdict, Verdict::Failed);
    for blob in blobs.iter().filter(|blob| !proofs.contains(blob)) {
        fs::remove_file(blob).unwrap();
    }
    assert_eq!(audit(dir.path(), Depth::Light, 2).0, light);
    let (without, _) = audit(dir.path(), Depth::Full, 2);
    // Among the missing blobs is an accepted update.
    assert_eq!(without.verdict, Verdict::Failed, "{:?}", without.findings);
    assert!(notes(&without)
        .iter()
        .any(|note| note.contains("not at hand")));
    // Both kinds of audits need the proof.
    fs::write(accepted_proof(dir.path()), b"changed").unwrap();
    assert_eq!(
        audit(dir.path(), Depth::Light, 2).0.verdict,
        Verdict::Failed
    );
}

#[test]
fn several_threads_find_what_one_finds_in_blobs_too() {
    let dir = copy_of(Path::new(REAL));
    let same = |what: &str| {
        for depth in [Depth::Light, Depth::Full] {
            let alone = audit(dir.path(), depth, 1);
            for threads in [2, 5] {
                assert_eq!(audit(dir.path(), depth, threads), alone, "{what}");
            }
        }
        audit(dir.path(), Depth::Full, 2).0.verdict
    };
    assert_eq!(same("as it is"), Verdict::Verified);
    for blob in blobs(dir.path()) {
        let whole = fs::read(&blob).unwrap();
        let mut changed = whole.clone();
        changed[whole.len() / 2] ^= 1;
        fs::write(&blob, changed).unwrap();
        assert_eq!(same("a changed blob"), Verdict::Failed);
        fs::remove_file(&blob).unwrap();
        same("a missing blob");
        fs::write(&blob, whole).unwrap();
    }
    // All proofs are damaged at once. The faults come in the order of their entries.
    for blob in proofs(dir.path()) {
        fs::write(blob, b"no proof").unwrap();
    }
    assert_eq!(same("no proof at all"), Verdict::Failed);
    let faults: Vec<_> = audit(dir.path(), Depth::Full, 5)
        .0
        .findings
        .iter()
        .filter_map(|finding| finding.index)
        .collect();
    assert!(faults.len() >= 2 && faults.is_sorted(), "{faults:?}");
}

/// The sizes that have a checkpoint, each with the text.
fn checkpoints(dir: &Path) -> BTreeMap<u64, Vec<u8>> {
    let store = Store::open_read_only(&folder::database(dir)).unwrap();
    (1..=store.size().unwrap())
        .filter_map(|size| Some((size, store.checkpoint(size).unwrap()?)))
        .collect()
}

/// Takes the ledger in `dir` back to what it was with `size` entries.
fn cut(dir: &Path, size: u64, checkpoint: &[u8]) {
    let db = DB::open_default(folder::database(dir)).unwrap();
    let hashes = tlog_tiles::tlog::stored_hash_count(size);
    for key in db
        .iterator(rocksdb::IteratorMode::Start)
        .map(|found| found.unwrap().0)
        .collect::<Vec<_>>()
    {
        let number = u64::from_be_bytes(key[1..].try_into().unwrap());
        let beyond = match key[0] {
            b'e' => number >= size,
            b'h' => number >= hashes,
            _ => number > size,
        };
        if beyond {
            db.delete(key).unwrap();
        }
    }
    fs::write(folder::checkpoint(dir), checkpoint).unwrap();
}

/// Audits `dir` and remembers the result in `file`. If `file` holds an earlier audit, goes on from there.
fn go_on(dir: &Path, depth: Depth, file: &Path) -> Result<(ReplayReport, Checked), String> {
    let from = SavedReplay::read(file).unwrap();
    let auditor = Auditor::new(depth);
    let mut auditor = match &from {
        Some(saved) => auditor.go_on(&saved.recheck, &Blobs::at(dir))?,
        None => auditor,
    };
    let options = ReplayOptions {
        from,
        keep: Some(SaveOptions {
            path: file.into(),
            every: Duration::ZERO,
        }),
        ..ReplayOptions::default()
    };
    let report = replay_with(dir, options, &mut auditor);
    Ok((report, auditor.checked()))
}

#[test]
fn an_audit_in_two_parts_ends_as_one_wherever_it_is_parted() {
    let whole = copy_of(Path::new(REAL));
    let parts = checkpoints(whole.path());
    assert!(parts.len() > 3);
    for depth in [Depth::Light, Depth::Full] {
        let expected = audit(whole.path(), depth, 2);
        for (size, text) in &parts {
            let (part, scratch) = (copy_of(whole.path()), tempfile::tempdir().unwrap());
            let file = scratch.path().join("state");
            cut(part.path(), *size, text);
            let (first, _) = go_on(part.path(), depth, &file).unwrap();
            let verdict = match depth {
                Depth::Light => Verdict::Incomplete,
                Depth::Full => Verdict::Verified,
            };
            assert_eq!((first.verdict, first.entries), (verdict, *size));
            let then = go_on(whole.path(), depth, &file).unwrap();
            assert_eq!(then, expected, "parted at {size}");
        }
        // The audit goes on checkpoint by checkpoint, always with the same state file.
        let scratch = tempfile::tempdir().unwrap();
        let file = scratch.path().join("state");
        for (size, text) in &parts {
            let part = copy_of(whole.path());
            cut(part.path(), *size, text);
            go_on(part.path(), depth, &file).unwrap();
        }
        assert_eq!(go_on(whole.path(), depth, &file).unwrap(), expected);
        let other = match depth {
            Depth::Light => Depth::Full,
            Depth::Full => Depth::Light,
        };
        let refused = go_on(whole.path(), other, &file).unwrap_err();
        assert!(refused.contains("the state file is from a"), "{refused}");
    }
}

#[test]
fn a_proof_that_goes_missing_before_its_round_closes_is_missed() {
    let whole = copy_of(Path::new(REAL));
    let accepted = |entry: &Entry| matches!(entry.body, Body::ContributionAccepted(_));
    let at = entries(whole.path()).iter().position(accepted).unwrap() as u64 + 1;
    let (size, text) = checkpoints(whole.path())
        .range(at..)
        .next()
        .map(|(s, t)| (*s, t.clone()))
        .unwrap();
    let (part, scratch) = (copy_of(whole.path()), tempfile::tempdir().unwrap());
    let file = scratch.path().join("state");
    cut(part.path(), size, &text);
    // While the round is open, only its aggregator has the proof.
    let proof = &accepted_proof(part.path());
    let bytes = fs::read(proof).unwrap();
    let name = proof.file_name().unwrap();
    fs::remove_file(proof).unwrap();
    let (first, _) = go_on(part.path(), Depth::Full, &file).unwrap();
    assert_eq!(first.verdict, Verdict::Incomplete, "{:?}", first.findings);
    let open = notes(&first)
        .iter()
        .any(|note| note.contains("once its round closes"));
    assert!(open, "{:?}", first.findings);
    // After the round has closed, the proof has to be there.
    let kept = fs::read(&file).unwrap();
    let place = whole.path().join("blobs/sha256").join(name);
    fs::remove_file(&place).unwrap();
    let (then, _) = go_on(whole.path(), Depth::Full, &file).unwrap();
    assert_eq!(then.verdict, Verdict::Failed);
    fs::write(&file, kept).unwrap();
    fs::write(&place, bytes).unwrap();
    let (then, _) = go_on(whole.path(), Depth::Full, &file).unwrap();
    assert_eq!(then, audit(whole.path(), Depth::Full, 1).0);
}

#[test]
fn a_refusal_whose_proof_was_private_is_checked_once_its_round_has_closed() {
    let proof = b"no proof";
    let truth = RefusalCode::MalformedProof;
    let lie = RefusalCode::InvalidProof;
    for (reason, verdict) in [(truth, Verdict::Verified), (lie, Verdict::Failed)] {
        let (whole, scratch) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let file = scratch.path().join("state");
        let node = SigningNode::new(1);
        let mut operator = Operator::founds(whole.path(), genesis(), &[&node]);
        operator.open();
        let submission = operator.submission(&node, 1, proof);
        let refused = operator.append(Body::ContributionRejected { submission, reason });
        let text = fs::read(folder::checkpoint(whole.path())).unwrap();
        operator.close(0);
        drop(operator);
        // While the round is open, only its aggregator has the proof.
        let part = copy_of(whole.path());
        cut(part.path(), refused + 1, &text);
        let private = Blobs::at(part.path()).path(&zk0_verifier::blob_digest(proof));
        fs::remove_file(private).unwrap();
        let first = go_on(part.path(), Depth::Full, &file).unwrap();
        assert_eq!(first.0.verdict, Verdict::Incomplete, "{:?}", first.0);
        assert!(notes(&first.0)
            .iter()
            .any(|note| note.contains("looked for again once its round closes")));
        assert_eq!(go_on(part.path(), Depth::Full, &file).unwrap(), first);
        // After the round has closed, everybody has it.
        let then = go_on(whole.path(), Depth::Full, &file).unwrap();
        assert_eq!(then, audit(whole.path(), Depth::Full, 1));
        assert_eq!(then.0.verdict, verdict, "{:?}", then.0.findings);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_checked_is_counted_by_kind() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    for node in [&first, &second] {
        let claim = node.claim(&network).await;
        node.submit(&network, claim, b"no proof").await?;
    }
    network.settle().await;
    let dir = network.dir.path();
    let mut auditor = Auditor::new(Depth::Light);
    let report = replay(dir, None, &mut auditor);
    assert_eq!(report.verdict, Verdict::Incomplete, "{:?}", report.findings);
    let left_out: BTreeMap<_, _> = auditor
        .not_checked()
        .into_iter()
        .map(|line| ((line.what, line.why), line.count))
        .collect();
    assert_eq!(left_out[&(CheckKind::Datasets, SkipReason::Light)], 2);
    assert_eq!(left_out[&(CheckKind::Policy, SkipReason::Light)], 1);
    assert_eq!(auditor.checked().refusals, 2, "proofs were looked at");
    // The rules state that nobody contributed, so there is no average to leave out.
    assert!(!left_out.contains_key(&(CheckKind::Averages, SkipReason::Light)));
    // The evidence is gone. The report has one line for both refusals.
    fs::remove_file(Blobs::at(dir).path(&zk0_verifier::blob_digest(b"no proof")))?;
    let mut auditor = Auditor::new(Depth::Light);
    replay(dir, None, &mut auditor);
    let lines = auditor.not_checked();
    let line = lines.iter().find(|line| line.what == CheckKind::Refusals);
    let line = line.ok_or("nothing is stated of refusals")?;
    assert_eq!((line.why, line.count), (SkipReason::NotAtHand, 2));
    assert!(
        line.to_string()
            .starts_with("2 refusals' reasons: the first, "),
        "{line}"
    );
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_dispute_is_decided_as_verification_says() -> Test {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    let submission = first.submission(first.claim(&network).await, b"no proof");
    let late = second.submission(second.claim(&network).await, b"none either");
    let bytes = [b"no proof".as_slice(), b"none either"];
    let put = move |aggregator: &mut zk0_aggregator::Aggregator| {
        for bytes in bytes {
            aggregator.ledger().blobs().put(bytes)?;
        }
        Ok(())
    };
    network.service().with(put).await?;
    // An operator who holds the log's key accepts a contribution that does not verify, and decides as he likes when it is disputed.
    let cases = [
        (None, false),
        (Some(RefusalCode::OtherProgram), false),
        (Some(RefusalCode::MalformedProof), true),
    ];
    for (upheld, holds) in cases {
        let dir = copy_of(network.dir.path());
        let mut ledger = Ledger::open(dir.path(), None, log_key())?;
        let accepted = ledger.append(START_MS, Body::ContributionAccepted(submission.clone()))?;
        ledger.append(
            START_MS,
            Body::ContributionRejected {
                submission: late.clone(),
                reason: RefusalCode::MalformedProof,
            },
        )?;
        let state = ledger.state();
        let closed = RoundClosed {
            round: 0,
            global: digest(&weights(9)),
            contributors: state.contributors(),
            unanswered: state.unanswered(),
            evaluated: None,
        };
        let dispute = Dispute {
            network: *state.network(),
            disputer: second.id(),
            contribution: accepted.index,
            evidence: Evidence::Verification,
        };
        ledger.append(START_MS, Body::RoundClosed(closed))?;
        let dispute = Body::Disputed(Signed::new(dispute, &second.key));
        let dispute = ledger.append(START_MS, dispute)?.index;
        let resolved = DisputeResolved { dispute, upheld };
        let index = ledger
            .append(START_MS, Body::DisputeResolved(resolved))?
            .index;
        drop(ledger);
        let mut auditor = Auditor::new(Depth::Full);
        let report = replay(dir.path(), None, &mut auditor);
        let reported = report.findings.iter().any(|finding| {
            finding.index == Some(index)
                && finding
                    .text
                    .contains("verification states: this is not an SP1")
        });
        assert_eq!(reported, !holds, "{:?}", report.findings);
        assert_eq!(auditor.checked().disputes, u64::from(holds));
        // The audit runs in two parts, and the contribution is in the first part.
        let scratch = tempfile::tempdir()?;
        let file = scratch.path().join("state");
        let part = copy_of(dir.path());
        let (size, text) = checkpoints(dir.path())
            .into_iter()
            .rfind(|(size, _)| *size < index)
            .ok_or("no earlier checkpoint")?;
        cut(part.path(), size, &text);
        go_on(part.path(), Depth::Full, &file)?;
        let then = go_on(dir.path(), Depth::Full, &file)?;
        assert_eq!(then, (report, auditor.checked()));
    }
    Ok(())
}
