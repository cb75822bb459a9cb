//! What was pruned counts if the log's present key has signed it. The operator, who changes the key, has it signed again, and nobody else: a
//! thief of a former key could sign anything.

use super::log_keys::{given, opened, rotates};
use super::*;
use crate::network::log_keys::*;
use ed25519_dalek::SigningKey;
use zk0_ledger::backup::backup;
use zk0_ledger::Blobs;
use zk0_protocol::tlog::key_rotation::LogKeyRotation;
use zk0_protocol::Signed;

impl Grown {
    /// With a statement, in the folder and in the store, about the updates of rounds before the third.
    fn pruned() -> Self {
        let grown = Self::new();
        let ledger = grown.memory.open(grown.dir()).unwrap();
        pruning(&ledger, 3).carry_out(&ledger).unwrap();
        drop(ledger);
        grown.has_signed(grown.dir(), &log_key());
        grown
    }

    /// Opens the ledger in `dir`, to give the log this key.
    fn to_rotate(&self, dir: &Path, key: SigningKey) -> Ledger {
        let blobs = Blobs::in_store(dir, Box::new(self.memory.clone())).unwrap();
        opened(dir, key, blobs).unwrap()
    }

    /// The statement in the store.
    fn stored(&self) -> Option<Vec<u8>> {
        self.memory.change(|kept| kept.pruned.clone())
    }

    fn put(&self, statement: &[u8]) {
        self.memory
            .change(|kept| kept.pruned = Some(statement.to_vec()));
    }

    /// The folder and the store have the statement, signed with this key.
    #[track_caller]
    fn has_signed(&self, dir: &Path, key: &SigningKey) {
        let signed = pruned::read(dir, &genesis()).unwrap().unwrap();
        assert_eq!((signed.operator, signed.updates_before), (public(key), 3));
        assert_eq!(self.stored(), held(dir));
    }

    /// The log's key does not open the ledger, because another one has signed the statement. All stays as it is.
    #[track_caller]
    fn refuses_former(&self, dir: &Path, key: SigningKey) {
        let before = (held(dir), self.stored(), self.memory.groups());
        let refused = self.memory.open_as(dir, key).map(drop).unwrap_err();
        is_former(&refused);
        assert_eq!((held(dir), self.stored(), self.memory.groups()), before);
    }
}

/// The statement in the folder.
fn held(dir: &Path) -> Option<Vec<u8>> {
    fs::read(folder::pruned(dir)).ok()
}

#[track_caller]
fn is_former(refused: &LedgerError) {
    assert!(
        matches!(refused, LedgerError::FormerPruning { .. }),
        "{refused}"
    );
    let remedy = "run `zk0 aggregator rotate-log-key` with the same keys again";
    assert!(refused.to_string().contains(remedy), "{refused}");
}

/// What a thief of the first of the log's later keys signs: that nothing is kept.
fn by_thief(given: &Signed<LogKeyRotation>, entries: u64) -> Vec<u8> {
    let statement = Pruning {
        network: genesis().network_id(),
        operator: public(&later_key(1)),
        entries,
        updates_before: u64::MAX,
        proofs_before: u64::MAX,
        weights_before: u64::MAX,
    };
    let signed = Signed::new(statement, &later_key(1));
    [
        borsh::to_vec(&signed).unwrap(),
        borsh::to_vec(given).unwrap(),
    ]
    .concat()
}

#[test]
fn what_was_pruned_is_signed_again_with_a_new_key() {
    let grown = Grown::pruned();
    for number in [1, 2] {
        let before = grown.stored().unwrap();
        let key = later_key(number);
        let mut ledger = grown.to_rotate(grown.dir(), key.clone());
        ledger.rotate_key(&log_key(), T0 + 2).unwrap();
        drop(ledger);
        grown.has_signed(grown.dir(), &key);
        drop(grown.memory.open_as(grown.dir(), key.clone()).unwrap());
        // A thief of the former key writes into the bucket.
        grown.put(&before);
        drop(grown.memory.open_as(grown.dir(), key.clone()).unwrap());
        grown.has_signed(grown.dir(), &key);
    }
}

/// The process was killed, or the store did not answer, when the change of the key was recorded.
#[test]
fn an_interrupted_change_of_the_key_is_ended_by_the_same_command() {
    let grown = Grown::pruned();
    let former = grown.stored().unwrap();
    let mut ledger = grown.to_rotate(grown.dir(), later_key(1));
    let entry = ledger.size();
    grown.memory.change(|kept| kept.pruned_fails = true);
    ledger.rotate_key(&log_key(), T0 + 2).unwrap_err();
    drop(ledger);
    grown.memory.change(|kept| kept.pruned_fails = false);
    assert_eq!(held(grown.dir()).as_ref(), Some(&former));
    // Another folder is filled from the store, to which the first one has added an entry.
    let other = grown.other();
    for (dir, nodes) in [(grown.dir(), 6..7), (other.as_path(), 7..8)] {
        grown.put(&former);
        grown.refuses_former(dir, later_key(1));
        let mut ledger = grown.to_rotate(dir, later_key(1));
        let size = ledger.size();
        let receipt = ledger.rotate_key(&log_key(), T0 + 3).unwrap();
        assert_eq!((receipt.index, ledger.size()), (entry, size));
        drop(ledger);
        grown.has_signed(dir, &later_key(1));
        let mut ledger = grown.memory.open_as(dir, later_key(1)).unwrap();
        grow(&mut ledger, nodes);
    }
    // It was killed between the store and the folder.
    fs::write(folder::pruned(&other), &former).unwrap();
    drop(grown.memory.open_as(&other, later_key(1)).unwrap());
    grown.has_signed(&other, &later_key(1));
}

/// It would excuse all that a thief withholds.
#[test]
fn what_a_thief_of_a_former_key_signs_is_not_signed_again() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    founded(dir);
    let mut ledger = opened(dir, later_key(1), Blobs::at(dir)).unwrap();
    let given = given(&mut ledger);
    drop(ledger);
    let ledger = rotates(dir, later_key(2));
    let size = ledger.size();
    drop(ledger);
    // The key was the log's for one entry. It signs about a later one, and another key follows it.
    for (entries, key) in [(size, later_key(2)), (1, later_key(3))] {
        let forged = by_thief(&given, entries);
        fs::write(folder::pruned(dir), &forged).unwrap();
        is_former(&Ledger::open(dir, None, later_key(2)).map(drop).unwrap_err());
        let mut ledger = opened(dir, key, Blobs::at(dir)).unwrap();
        let refused = ledger.rotate_key(&log_key(), T0 + 3).unwrap_err();
        assert!(
            matches!(refused, LedgerError::BadPruning { .. }),
            "{refused}"
        );
        assert_eq!(ledger.size(), size);
        drop(ledger);
        assert_eq!(held(dir), Some(forged));
    }
    // The operator removes it.
    fs::remove_file(folder::pruned(dir)).unwrap();
    drop(Ledger::open(dir, None, later_key(2)).unwrap());
}

#[test]
fn what_a_thief_of_a_former_key_signs_gives_way_to_what_the_present_key_has_signed() {
    let grown = Grown::pruned();
    let mut ledger = grown.to_rotate(grown.dir(), later_key(1));
    let given = given(&mut ledger);
    drop(ledger);
    let mut ledger = grown.to_rotate(grown.dir(), later_key(2));
    ledger.rotate_key(&log_key(), T0 + 3).unwrap();
    let forged = by_thief(&given, ledger.size());
    drop(ledger);
    let scratch = tempfile::tempdir().unwrap();
    let copied = scratch.path().join("backup");
    backup(grown.dir(), &copied).unwrap();
    fs::write(folder::pruned(grown.dir()), &forged).unwrap();
    // A backup keeps the right one.
    backup(grown.dir(), &copied).unwrap();
    grown.has_signed(&copied, &later_key(2));
    // The folder takes the right one from the store.
    drop(grown.memory.open_as(grown.dir(), later_key(2)).unwrap());
    grown.has_signed(grown.dir(), &later_key(2));
    // An empty folder takes nothing else from there.
    grown.put(&forged);
    grown.refuses_former(&grown.other(), later_key(2));
    assert_eq!(held(&grown.other()), None);
}

#[test]
fn a_statement_that_the_log_has_not_signed_is_not_taken() {
    let grown = Grown::pruned();
    let mut changed = grown.stored().unwrap();
    *changed.last_mut().unwrap() ^= 1;
    // Also where the folder has the right one: the object may be of a later release.
    for wrong in [changed, b"something else".to_vec(), Vec::new()] {
        grown.put(&wrong);
        for dir in [grown.dir(), &grown.other()] {
            let before = (held(dir), grown.memory.groups());
            let refused = grown.memory.open(dir).map(drop).unwrap_err();
            assert!(
                matches!(refused, LedgerError::StoredPruning { .. }),
                "{refused}"
            );
            assert!(refused.is_of_stored_entries());
            let named = "the object `pruned` in the blob store memory";
            assert!(refused.to_string().contains(named), "{refused}");
            assert_eq!(grown.stored().as_ref(), Some(&wrong));
            assert_eq!((held(dir), grown.memory.groups()), before);
        }
    }
    grown.memory.change(|kept| kept.pruned = None);
    drop(grown.memory.open(grown.dir()).unwrap());
    grown.has_signed(grown.dir(), &log_key());
}
