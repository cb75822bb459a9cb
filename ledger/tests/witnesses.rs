//! A witness (C2SP tlog-witness) gives every answer of the specification, and never cosigns two histories.

use crate::network::log::{log_vkey, ORIGIN};
use crate::network::log_keys::*;
use crate::network::shelf::*;
use crate::network::*;
use ed25519_dalek::SigningKey;
use std::fs;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_ledger::witness_store::{hash, AddError, WitnessError, WitnessStore};
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::cosigner::{self, Cosigner};
use zk0_protocol::tlog::key_rotation::LogKeyRotation;
use zk0_protocol::tlog::witness::{AddCheckpoint, WitnessRefusal};
use zk0_protocol::{Checkpoint, Signed, VerifierKey, WitnessPolicy};
use zk0_testkit::until;

const NOW: u64 = 1_700_000_000;

fn cosigner() -> Cosigner {
    Cosigner::new("witness.example/w", SigningKey::from_bytes(&[200; 32])).unwrap()
}

/// Opens a witness that was just closed. A child process that another test starts at this moment holds the witness' lock until it runs its
/// program.
fn opened(dir: &Path) -> Result<WitnessStore, WitnessError> {
    until("the lock is free", || {
        match WitnessStore::open(dir, cosigner(), vec![log_vkey()]) {
            Err(WitnessError::Locked(_)) => None,
            opened => Some(opened),
        }
    })
}

fn witness(dir: &Path) -> WitnessStore {
    opened(dir).unwrap()
}

fn leaves(count: usize, fork_at: usize) -> Vec<Vec<u8>> {
    (0..count)
        .map(|index| format!("{index}{}", if index >= fork_at { "'" } else { "" }).into_bytes())
        .collect()
}

fn request(shelf: &Shelf, old: u64, size: u64) -> AddCheckpoint {
    let proof = match old == 0 || old >= size {
        true => Vec::new(),
        false => tlog_tiles::tlog::prove_tree(size, old, &shelf.store)
            .unwrap()
            .into_iter()
            .map(|hash| Digest(hash.0))
            .collect(),
    };
    AddCheckpoint {
        old,
        proof,
        checkpoint: shelf.checkpoint(size).sign(ORIGIN, &log_key()).unwrap(),
    }
}

/// Returns the HTTP status that the specification gives for the answer.
fn status(witness: &mut WitnessStore, request: &AddCheckpoint) -> u16 {
    match witness.add(&request.encode(), NOW) {
        Ok(line) => {
            let note = Parsed::read(&request.checkpoint).unwrap().note;
            let key = witness.key().clone();
            cosigner::find(&line, &key, &note).expect("a valid cosignature");
            200
        }
        Err(AddError::Refused(refusal)) => refusal.status(),
        Err(AddError::Failed(error)) => panic!("{error}"),
    }
}

#[test]
fn a_witness_answers_as_the_specification_says() {
    let dir = tempfile::tempdir().unwrap();
    let mut witness = witness(dir.path());
    let shelf = Shelf::of(&leaves(20, 99));
    let forked = Shelf::of(&leaves(20, 5));
    let ask = |witness: &mut WitnessStore, old, size| status(witness, &request(&shelf, old, size));
    // The witness has cosigned nothing yet, so only old size 0 is right, and only without a proof.
    assert_eq!(ask(&mut witness, 3, 8), 409);
    let mut with_proof = request(&shelf, 3, 8);
    with_proof.old = 0;
    assert_eq!(status(&mut witness, &with_proof), 422);
    assert_eq!(ask(&mut witness, 0, 8), 200);
    // The same checkpoint is sent again, and a later one is sent.
    assert_eq!(ask(&mut witness, 8, 8), 200);
    assert_eq!(ask(&mut witness, 8, 13), 200);
    // The request names an old size that is not the witness's last one. The answer states which is.
    for old in [0, 8, 12] {
        let refused = witness
            .add(&request(&shelf, old, 15).encode(), NOW)
            .unwrap_err();
        let AddError::Refused(WitnessRefusal::Conflict { last: 13, .. }) = refused else {
            panic!("{refused}");
        };
    }
    // The log is rolled back, so the old size is larger than the new one.
    assert_eq!(ask(&mut witness, 13, 12), 400);
    // The log is rolled back, and the request names an old size that is not the witness's last one.
    assert_eq!(ask(&mut witness, 8, 12), 409);
    // The log is forked, at the same size and at a later one.
    assert_eq!(status(&mut witness, &request(&forked, 13, 13)), 409);
    assert_eq!(status(&mut witness, &request(&forked, 13, 20)), 422);
    let mut honest_proof = request(&shelf, 13, 20);
    honest_proof.checkpoint = request(&forked, 13, 20).checkpoint;
    assert_eq!(status(&mut witness, &honest_proof), 422);
    // One hash of the proof is changed, one is missing, there is one too many, or there is none.
    for change in [
        |proof: &mut Vec<Digest>| proof[0].0[7] ^= 1,
        |proof: &mut Vec<Digest>| proof.truncate(proof.len() - 1),
        |proof: &mut Vec<Digest>| proof.push(digest(9)),
        |proof: &mut Vec<Digest>| proof.clear(),
    ] {
        let mut changed = request(&shelf, 13, 20);
        change(&mut changed.proof);
        assert_eq!(status(&mut witness, &changed), 422);
    }
    // A second operator's key signs the checkpoint, and then the checkpoint is of another log.
    let mut other = request(&shelf, 13, 20);
    other.checkpoint = shelf.checkpoint(20).sign(ORIGIN, &key(1)).unwrap();
    assert_eq!(status(&mut witness, &other), 403);
    other.checkpoint = shelf
        .checkpoint(20)
        .sign("another.log", &log_key())
        .unwrap();
    assert_eq!(status(&mut witness, &other), 404);
    // The checkpoint claims an empty tree with the root of another tree.
    let dir = tempfile::tempdir().unwrap();
    let mut fresh = WitnessStore::open(dir.path(), cosigner(), vec![log_vkey()]).unwrap();
    let empty = |root| AddCheckpoint {
        old: 0,
        proof: Vec::new(),
        checkpoint: Checkpoint { size: 0, root }
            .sign(ORIGIN, &log_key())
            .unwrap(),
    };
    assert_eq!(status(&mut fresh, &empty(digest(1))), 422);
    assert_eq!(
        status(&mut fresh, &empty(Digest(tlog_tiles::tlog::EMPTY_HASH.0))),
        200
    );
    assert_eq!(ask(&mut fresh, 0, 3), 200);
    // After all these requests, the honest log goes on.
    assert_eq!(ask(&mut witness, 13, 20), 200);
}

#[test]
fn a_request_has_one_form() {
    let shelf = Shelf::of(&leaves(20, 99));
    let good = request(&shelf, 8, 20);
    assert_eq!(AddCheckpoint::decode(&good.encode()), Ok(good.clone()));
    let text = String::from_utf8(good.encode()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let mut witness = witness(dir.path());
    let hash_line = format!("{}\n", tlog_tiles::tlog::Hash([1; 32]));
    for body in [
        String::new(),
        "old 8\n".into(),
        text.replacen("old 8", "old 08", 1),
        text.replacen("old 8", "old +8", 1),
        text.replacen("old 8", "old  8", 1),
        text.replacen("old 8", "new 8", 1),
        text.replacen("old 8\n", "old 8\nAAAA\n", 1),
        text.replacen("old 8\n", &format!("old 8\n{}", hash_line.repeat(64)), 1),
        text.replacen("\n\n", "\n", 1),
        text.replacen("\n20\n", "\n020\n", 1),
        text.replacen("\n20\n", "\n20 \n", 1),
        text.trim_end().to_owned(),
        "x".repeat(200_000),
    ] {
        match witness.add(body.as_bytes(), NOW) {
            Err(AddError::Refused(refusal)) => assert_eq!(refusal.status(), 400, "{body:.80}"),
            other => panic!("{body:.80}: {other:?}"),
        }
    }
}

#[test]
fn a_restarted_witness_knows_what_it_signed() {
    let dir = tempfile::tempdir().unwrap();
    let shelf = Shelf::of(&leaves(20, 99));
    let forked = Shelf::of(&leaves(20, 5));
    let mut first = witness(dir.path());
    assert_eq!(status(&mut first, &request(&shelf, 0, 8)), 200);
    drop(first);
    let mut again = witness(dir.path());
    assert_eq!(status(&mut again, &request(&forked, 0, 8)), 409);
    assert_eq!(status(&mut again, &request(&forked, 8, 9)), 422);
    assert_eq!(status(&mut again, &request(&shelf, 8, 9)), 200);
    // The witness shows monitors what it remembers, with both signatures.
    let note = again.last(&hash(ORIGIN)).unwrap().unwrap();
    let policy = format!("witness W {}\nquorum W\n", again.key());
    let opened = WitnessPolicy::parse(&policy)
        .unwrap()
        .open(&note, &log_vkey())
        .unwrap();
    assert_eq!(opened.checkpoint, shelf.checkpoint(9));
    assert_eq!(again.last(&hash("another.log")).unwrap(), None);
    // Two processes of the same witness at once would cosign two histories, so the second one does not start.
    let second = WitnessStore::open(dir.path(), cosigner(), vec![log_vkey()]);
    assert!(matches!(second, Err(WitnessError::Locked(_))));
}

/// A request with the signature of the later key `number`, which entry `entry` has given the log.
fn by_later_key(shelf: &Shelf, (number, entry): (u8, u64), old: u64, size: u64) -> AddCheckpoint {
    let key = later_key(number);
    let rotation = LogKeyRotation {
        entry,
        ..log_rotation(&Chain::new().state, &key)
    };
    let rotation = Signed::new(rotation, &log_key());
    let text = shelf
        .checkpoint(size)
        .sign_after(ORIGIN, &key, Some(&rotation));
    AddCheckpoint {
        checkpoint: text.unwrap(),
        ..request(shelf, old, size)
    }
}

#[test]
fn a_witness_remembers_the_later_of_two_keys_that_sign_one_tree() {
    let dir = tempfile::tempdir().unwrap();
    let shelf = Shelf::of(&leaves(20, 99));
    let mut first = witness(dir.path());
    let by = |number, entry, old, size| by_later_key(&shelf, (number, entry), old, size);
    assert_eq!(status(&mut first, &by(1, 8, 0, 10)), 200);
    assert_eq!(status(&mut first, &by(2, 9, 10, 10)), 200);
    assert_eq!(status(&mut first, &by(1, 8, 10, 12)), 403);
    drop(first);
    assert_eq!(status(&mut witness(dir.path()), &by(1, 8, 10, 12)), 403);
}

/// The witness is told of the founding key alone, and needs no other one when the log has another key.
#[test]
fn a_witness_follows_another_key_and_refuses_the_former_one() {
    let dir = tempfile::tempdir().unwrap();
    let shelf = Shelf::of(&leaves(20, 99));
    let mut first = witness(dir.path());
    assert_eq!(status(&mut first, &request(&shelf, 0, 8)), 200);
    let by = |number, entry, old, size| by_later_key(&shelf, (number, entry), old, size);
    assert_eq!(status(&mut first, &by(1, 8, 8, 10)), 200);
    // A thief has the founding key.
    let by_thief = request(&shelf, 10, 12);
    assert_eq!(status(&mut first, &by_thief), 403);
    drop(first);
    let mut again = witness(dir.path());
    let refused = again.add(&by_thief.encode(), NOW).unwrap_err().to_string();
    assert!(
        refused.contains("entry 8 gave the log another key"),
        "{refused}"
    );
    // An aggregator that was rolled back to before the change learns the size.
    assert_eq!(status(&mut again, &request(&shelf, 8, 9)), 409);
    assert_eq!(status(&mut again, &by(2, 12, 10, 13)), 200);
    assert_eq!(status(&mut again, &by(1, 8, 13, 15)), 403);
    assert_eq!(status(&mut again, &by(2, 12, 13, 15)), 200);
}

#[test]
fn a_witness_with_a_damaged_memory_does_not_start() {
    let dir = tempfile::tempdir().unwrap();
    let shelf = Shelf::of(&leaves(20, 99));
    assert_eq!(
        status(&mut witness(dir.path()), &request(&shelf, 0, 8)),
        200
    );
    let file = dir.path().join(hash(ORIGIN));
    let good = fs::read(&file).unwrap();
    let start = || opened(dir.path()).map(drop);
    // This checkpoint has no cosignature of this witness, so it does not show what the witness signed last.
    let without = shelf.checkpoint(9).sign(ORIGIN, &log_key()).unwrap();
    let mut changed = good.clone();
    changed[25] ^= 1;
    for bad in [
        &b""[..],
        &good[..good.len() - 1],
        &changed,
        &without,
        &[b'x'; 100_000],
    ] {
        fs::write(&file, bad).unwrap();
        assert!(matches!(start(), Err(WitnessError::Damaged { .. })));
    }
    fs::write(&file, &good).unwrap();
    start().unwrap();
}

#[test]
fn nothing_is_cosigned_that_cannot_be_remembered() {
    let dir = tempfile::tempdir().unwrap();
    let shelf = Shelf::of(&leaves(20, 99));
    let mut witness = witness(&dir.path().join("state"));
    assert_eq!(status(&mut witness, &request(&shelf, 0, 8)), 200);
    // Without its folder the witness cannot write, even if it runs as root.
    let (folder, away) = (dir.path().join("state"), dir.path().join("away"));
    fs::rename(&folder, &away).unwrap();
    let failed = witness.add(&request(&shelf, 8, 9).encode(), NOW);
    assert!(matches!(failed, Err(AddError::Failed(_))), "{failed:?}");
    fs::rename(&away, &folder).unwrap();
    // The witness still remembers the old size.
    assert_eq!(status(&mut witness, &request(&shelf, 8, 10)), 200);
}

/// An operator shows one history to one client and another history to another client. Two of the three witnesses have to cosign.
/// Whichever history the operator shows to which witness, one of the two clients gets no quorum.
#[test]
fn two_clients_cannot_be_shown_two_histories() {
    let honest = Shelf::of(&leaves(20, 99));
    let forked = Shelf::of(&leaves(20, 12));
    let names = ["A", "B", "C"];
    let cosigners = |at: usize| {
        let secret = SigningKey::from_bytes(&[150 + at as u8; 32]);
        Cosigner::new(&format!("witness.example/{}", names[at]), secret).unwrap()
    };
    let mut policy: String = (0..3)
        .map(|at| format!("witness {} {}\n", names[at], cosigners(at).key()))
        .collect();
    policy.push_str("group two 2 A B C\nquorum two\n");
    let policy = WitnessPolicy::parse(&policy).unwrap();
    // The operator shows each witness one history first and the other one after, in every possible combination.
    for order in 0..8u8 {
        let dirs: Vec<_> = (0..3).map(|_| tempfile::tempdir().unwrap()).collect();
        let mut notes =
            [&honest, &forked].map(|shelf| shelf.checkpoint(20).sign(ORIGIN, &log_key()).unwrap());
        for (at, dir) in dirs.iter().enumerate() {
            let mut witness =
                WitnessStore::open(dir.path(), cosigners(at), vec![log_vkey()]).unwrap();
            let first = usize::from(order >> at & 1);
            for history in [first, 1 - first] {
                let shelf = [&honest, &forked][history];
                for old in [0, 10, 20] {
                    if let Ok(line) = witness.add(&request(shelf, old, 20).encode(), NOW) {
                        notes[history].extend(line);
                        break;
                    }
                }
            }
        }
        let accepted = notes
            .iter()
            .filter(|note| policy.open(note, &log_vkey()).is_ok())
            .count();
        assert_eq!(accepted, 1, "order {order:03b}");
    }
}

/// Whoever knows a public checkpoint can send it again and again. The witness answers from its file, and writes nothing.
#[test]
fn a_checkpoint_that_is_sent_again_gets_the_cosignature_that_it_has() {
    let dir = tempfile::tempdir().unwrap();
    let shelf = Shelf::of(&leaves(20, 99));
    let send = |witness: &mut WitnessStore, old, size, at| {
        witness.add(&request(&shelf, old, size).encode(), NOW + at)
    };
    let mut first = witness(dir.path());
    let cosignature = send(&mut first, 0, 8, 0).unwrap();
    let file = dir.path().join(hash(ORIGIN));
    let kept = fs::read(&file).unwrap();
    assert!(kept.ends_with(&cosignature));
    assert_eq!(send(&mut first, 8, 8, 1).unwrap(), cosignature);
    drop(first);
    let mut again = witness(dir.path());
    assert_eq!(send(&mut again, 8, 8, 2).unwrap(), cosignature);
    assert_eq!(fs::read(&file).unwrap(), kept);
    // A later checkpoint is cosigned anew.
    let later = send(&mut again, 8, 13, 3).unwrap();
    assert!(fs::read(&file).unwrap().ends_with(&later));
}

#[test]
fn one_log_is_watched_under_one_key() {
    let dir = tempfile::tempdir().unwrap();
    let other = VerifierKey::new(
        zk0_protocol::tlog::verifier_key::Role::Log,
        ORIGIN,
        key(1).verifying_key().as_bytes(),
    );
    let two = vec![log_vkey(), other.unwrap()];
    let opened = WitnessStore::open(dir.path(), cosigner(), two).map(drop);
    assert!(matches!(opened, Err(WitnessError::Log(_))));
}
