//! A ledger refuses entries that are too large before anything is written, and names bad entries that it finds on disk.

use crate::network::*;
use rocksdb::DB;
use zk0_ledger::group::WantedEntry;
use zk0_ledger::replay::{replay, Verdict};
use zk0_ledger::store::{Store, StoreBatch};
use zk0_ledger::{Ledger, LedgerError};
use zk0_protocol::entries::authentic::{Authentic, AuthenticBody};
use zk0_protocol::entries::codec::EntryError;
use zk0_protocol::entries::entry::MAX_ENTRY_BYTES;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::signed::DatasetRegistration;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Checkpoint, Refusal, RefusalCode, RuleViolation, Signed};

/// Makes an entry of exactly this many bytes: an enrolment with a long name.
fn of_bytes(bytes: usize) -> Body {
    let named = |length: usize| {
        Body::NodeEnrolled(NodeEnrolled {
            node: id(1),
            name: "n".repeat(length),
        })
    };
    let empty = borsh::to_vec(&entry(T0, named(0))).unwrap().len();
    named(bytes - empty)
}

#[test]
fn an_entry_over_the_limit_is_refused_and_the_log_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    for bytes in [MAX_ENTRY_BYTES + 1, 1 << 20] {
        let alone = ledger.append(T0, of_bytes(bytes)).map(drop);
        match alone {
            Err(LedgerError::Rule(RuleViolation::Entry(EntryError::TooLarge(found)))) => {
                assert_eq!(found, bytes)
            }
            other => panic!("{other:?}"),
        }
        let among = ledger.append_all(T0, vec![of_bytes(bytes), of_bytes(bytes)]);
        match among {
            Err(LedgerError::Rule(RuleViolation::Entry(EntryError::TooLarge(found)))) => {
                assert_eq!(found, bytes)
            }
            other => panic!("{other:?}"),
        }
    }
    // An entry of exactly the limit is read, and the rules decide about it.
    let at_limit = ledger.append(T0, of_bytes(MAX_ENTRY_BYTES)).map(drop);
    assert!(
        matches!(
            at_limit,
            Err(LedgerError::Rule(RuleViolation::BadNode { .. }))
        ),
        "{at_limit:?}"
    );
    // A node signed this registration, which has more episodes than an entry holds.
    ledger.append(T0, enrolled(0)).unwrap();
    let network = *ledger.state().network();
    let endless = DatasetRegistration {
        episodes: (0..3000u32)
            .map(|number| {
                let mut digest = [0; 32];
                digest[..4].copy_from_slice(&number.to_be_bytes());
                episode(zk0_circuits::Digest(digest))
            })
            .collect(),
        ..registration(&network, 0)
    };
    let refused = ledger.append(T0, Body::DatasetCommitted(Signed::new(endless, &key(0))));
    assert!(
        matches!(
            refused,
            Err(LedgerError::Rule(RuleViolation::Entry(
                EntryError::TooLarge(_)
            )))
        ),
        "{refused:?}"
    );
    ledger.append(T0, registered(&network, 0)).unwrap();
    drop(ledger);
    let report = replay(dir.path(), None, &mut ());
    assert_eq!((report.verdict, report.entries), (Verdict::Verified, 3));
}

/// An operator with the log's key can put such bytes on disk without our code. Even if they are signed, every reader refuses them.
#[test]
fn signed_or_not_such_bytes_on_disk_are_refused_by_name() {
    let good = entry(T0, enrolled(1)).encode().unwrap();
    let last = good.len() - 1;
    for (at, byte, words) in [
        (0, 9, "version 9"),
        (10, 200, "not an entry"),
        (last, 0xff, "not an entry"),
    ] {
        let mut bytes = good.clone();
        bytes[at] = byte;
        let dir = tempfile::tempdir().unwrap();
        let (ledger, receipt) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
        drop(ledger);
        let mut tree = Frontier::default();
        tree.push(&receipt.entry).unwrap();
        let hashes = tree.push(&bytes).unwrap();
        let signed = Checkpoint {
            size: 2,
            root: tree.root().unwrap(),
        };
        let text = signed.sign(&genesis().name, &log_key()).unwrap();
        let store = Store::open(&dir.path().join("log")).unwrap();
        let mut batch = StoreBatch::default();
        batch.entry(1, &bytes, &hashes);
        batch.checkpoint(2, &text);
        store.commit(batch).unwrap();
        drop(store);
        std::fs::write(dir.path().join("checkpoint"), &text).unwrap();
        match Ledger::open(dir.path(), None, log_key()).map(drop) {
            Err(LedgerError::BadEntry { index: 1, why }) => {
                assert!(why.contains(words), "{why}")
            }
            other => panic!("{other:?}"),
        }
        let report = replay(dir.path(), None, &mut ());
        assert_eq!(report.verdict, Verdict::Failed);
        assert_eq!(report.findings[0].index, Some(1));
        assert!(report.findings[0].text.contains(words));
        // The log before the bad entry is intact.
        let db = DB::open_default(dir.path().join("log")).unwrap();
        assert_eq!(
            db.get(*b"e\0\0\0\0\0\0\0\0").unwrap(),
            Some(receipt.entry.clone())
        );
    }
}

#[test]
fn only_the_submission_that_was_verified_is_not_verified_again() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    let network = *ledger.state().network();
    for node in 0..2 {
        ledger.append(T0, enrolled(node)).unwrap();
        ledger.append(T0, registered(&network, node)).unwrap();
    }
    let opened = opened(ledger.state(), T0);
    ledger.append(T0, Body::RoundOpened(opened)).unwrap();
    for node in 0..2 {
        let body = committed(ledger.state(), node, weights(node + 1));
        ledger.append(T0, body).unwrap();
    }
    let closing = Body::CommitmentsClosed(commitments_closed(ledger.state()));
    ledger.append(T0, closing).unwrap();
    let drawing = Body::RandomnessDrawn(drawn(ledger.state()));
    ledger.append(T0, drawing).unwrap();
    let verified = submission(claim(ledger.state(), 0), 0);
    let mut others = [verified.clone(), submission(claim(ledger.state(), 1), 1)];
    for other in &mut others {
        other.signature[0] ^= 1;
        assert!(Authentic::of(other.clone()).is_err());
        let forged = Body::ContributionAccepted(other.clone());
        let refused = AuthenticBody::of(forged).unwrap_err();
        assert!(
            matches!(
                refused,
                RuleViolation::Refused(Refusal {
                    code: RefusalCode::Signature,
                    ..
                })
            ),
            "{refused:?}"
        );
    }
    let body = AuthenticBody::decided(&Authentic::of(verified).unwrap(), None);
    let recorded = ledger
        .commit(vec![WantedEntry { time_ms: T0, body }])
        .unwrap();
    assert!(recorded[0].is_ok(), "{recorded:?}");
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified);
}
