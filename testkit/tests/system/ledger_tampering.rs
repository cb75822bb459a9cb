//! The replay of a real ledger succeeds. With any changed byte in an entry, a proof or a checkpoint, it fails.

use rocksdb::{IteratorMode, DB};
use std::fs;
use std::path::Path;

use crate::real_ledger::ledger_copy;
use zk0_audit::verified_entries::{network_id, verified_entries};
use zk0_audit::Auditor;
use zk0_ledger::replay::{replay, Verdict};
use zk0_protocol::entries::entry::Body;

fn verdict(dir: &Path) -> Verdict {
    replay(dir, None, &mut Auditor::default()).verdict
}

fn flip(path: &Path, at: usize) {
    let mut bytes = fs::read(path).unwrap();
    bytes[at] ^= 1;
    fs::write(path, bytes).unwrap();
}

#[test]
fn a_real_ledger_is_verified_with_an_acceptance_and_a_refusal() {
    let dir = ledger_copy();
    let (entries, report) = verified_entries(dir.path()).unwrap();
    assert_eq!(report.verdict, Verdict::Verified, "{report:?}");
    let accepted = entries
        .iter()
        .filter(|entry| matches!(entry.body, Body::ContributionAccepted(_)))
        .count();
    let refused = entries
        .iter()
        .filter(|entry| matches!(entry.body, Body::ContributionRejected { .. }))
        .count();
    assert!(
        accepted >= 1 && refused >= 1,
        "{accepted} accepted, {refused} refused"
    );
}

/// So many threads change bytes, each in a copy of its own.
const PARTS: usize = 2;

#[test]
fn any_byte_of_every_entry_hash_and_stored_checkpoint() {
    std::thread::scope(|scope| {
        for part in 0..PARTS {
            scope.spawn(move || any_byte_of_records(part));
        }
    });
}

/// Changes the bytes of each record whose number is `part` modulo [`PARTS`].
fn any_byte_of_records(part: usize) {
    let dir = ledger_copy();
    let db = DB::open_default(dir.path().join("log")).unwrap();
    let records: Vec<_> = db
        .iterator(IteratorMode::Start)
        .map(Result::unwrap)
        .collect();
    for (key, value) in records.iter().skip(part).step_by(PARTS) {
        for at in 0..value.len() {
            let mut changed = value.to_vec();
            changed[at] ^= 1 << (at % 8);
            db.put(key, &changed).unwrap();
            let verdict = replay(dir.path(), None, &mut ()).verdict;
            assert_eq!(verdict, Verdict::Failed, "byte {at} of {key:?}");
        }
        db.put(key, value).unwrap();
    }
    drop(db);
    assert_eq!(verdict(dir.path()), Verdict::Verified);
}

#[test]
fn any_byte_of_the_published_checkpoint() {
    let dir = ledger_copy();
    let path = dir.path().join("checkpoint");
    let whole = fs::read(&path).unwrap();
    for at in 0..whole.len() {
        flip(&path, at);
        // The ledger's own checks notice the change, so no proof has to be verified again.
        assert_eq!(
            replay(dir.path(), None, &mut ()).verdict,
            Verdict::Failed,
            "byte {at}"
        );
        fs::write(&path, &whole).unwrap();
    }
    assert_eq!(verdict(dir.path()), Verdict::Verified);
}

#[test]
fn a_byte_of_any_proof_or_weights() {
    let dir = ledger_copy();
    for blob in fs::read_dir(dir.path().join("blobs/sha256")).unwrap() {
        let path = blob.unwrap().path();
        let whole = fs::read(&path).unwrap();
        for at in [0, whole.len() / 2, whole.len() - 1] {
            flip(&path, at);
            assert_eq!(
                verdict(dir.path()),
                Verdict::Failed,
                "{} byte {at}",
                path.display()
            );
        }
        fs::write(&path, &whole).unwrap();
    }
    assert_eq!(verdict(dir.path()), Verdict::Verified);
}

#[test]
fn a_missing_proof() {
    let dir = ledger_copy();
    let (entries, _) = verified_entries(dir.path()).unwrap();
    let proof = entries.iter().find_map(|entry| match &entry.body {
        Body::ContributionAccepted(submission) => Some(submission.statement.proof),
        _ => None,
    });
    fs::remove_file(
        dir.path()
            .join("blobs/sha256")
            .join(proof.unwrap().to_string()),
    )
    .unwrap();
    assert_eq!(verdict(dir.path()), Verdict::Failed);
}

#[test]
fn another_network() {
    let dir = ledger_copy();
    let id = network_id(dir.path()).unwrap();
    assert_eq!(
        replay(dir.path(), Some(&id), &mut ()).verdict,
        Verdict::Verified
    );
    let other = zk0_circuits::Digest([1; 32]);
    assert_eq!(
        replay(dir.path(), Some(&other), &mut ()).verdict,
        Verdict::Failed
    );
}
