//! The key that the log has now, as its entries show.

use std::fs;
use zk0_audit::log_source::present_key_at;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::published::export::export;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::Ledger;
use zk0_protocol::tlog::checkpoint::{log_key as verifier_key, KeyedCheckpoint};
use zk0_testkit::network::log_keys::later_key;
use zk0_testkit::network::{genesis, log_key, T0};

#[test]
fn a_former_key_is_not_told_to_be_the_present_one() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, out) = (scratch.path().join("ledger"), scratch.path().join("export"));
    drop(Ledger::create(&dir, genesis(), log_key(), T0).unwrap());
    let (genesis, present) = (genesis(), later_key(1));
    let key_of_copy = || {
        export(&Publication::open(&dir, None).unwrap(), &out).unwrap();
        let [there, copied] = [&dir, &out].map(|log| present_key_at(log.to_str().unwrap(), None));
        let there = there.unwrap().to_string();
        assert_eq!(copied.unwrap().to_string(), there);
        there
    };
    let expected = |key: &[u8; 32]| {
        let key = verifier_key(genesis.origin(), key);
        key.unwrap().to_string()
    };
    assert_eq!(key_of_copy(), expected(&genesis.log_key));
    let opened =
        Ledger::open_to_rotate(&dir, None, present.clone(), None, Blobs::at(&dir), &mut ());
    let mut ledger = opened.unwrap();
    ledger.rotate_key(&log_key(), T0 + 1).unwrap();
    let newest = ledger.checkpoint().to_vec();
    drop(ledger);
    assert_eq!(key_of_copy(), expected(present.verifying_key().as_bytes()));
    // A thief serves the log.
    let newest = KeyedCheckpoint::open(&newest, genesis.origin(), &genesis.log_key).unwrap();
    let by_thief = newest
        .checkpoint
        .sign(genesis.origin(), &log_key())
        .unwrap();
    fs::write(out.join("checkpoint"), by_thief).unwrap();
    let refused = present_key_at(out.to_str().unwrap(), None).unwrap_err();
    let words = "is not the log's key there";
    assert!(refused.to_string().contains(words), "{refused}");
}
