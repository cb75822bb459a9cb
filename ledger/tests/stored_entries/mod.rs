//! The log's entries in a store: what is acknowledged is there, an empty folder is filled from it, and of two writers one is fenced off.

mod log_keys;
mod memory;
mod signed_again;

use crate::network::rounds::{copy, ledger_with_a_round};
use crate::network::*;
use memory::Memory;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use tempfile::TempDir;
use zk0_circuits::NodeId;
use zk0_ledger::blobs::entry_objects::{group_name, group_of};
use zk0_ledger::prune::PrunePlan;
use zk0_ledger::replay::{replay, Verdict};
use zk0_ledger::stored_entries::{decode, encode, StoredEntry};
use zk0_ledger::{folder, pruned, Ledger, LedgerError};
use zk0_protocol::entries::entry::needs_checkpoint;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::{Body, Entry};

fn founded(dir: &Path) {
    Ledger::create(dir, genesis(), log_key(), T0).unwrap();
}

/// Appends some entries as one group.
fn grow(ledger: &mut Ledger, nodes: std::ops::Range<u8>) {
    let joining = nodes.map(enrolled).collect::<Vec<Body>>();
    ledger.append_all(T0 + 1, joining).unwrap();
}

/// The bytes of all entries in the folder.
fn entries(dir: &Path) -> Vec<Vec<u8>> {
    let ledger = Ledger::open(dir, None, log_key()).unwrap();
    let all = 0..ledger.size();
    all.map(|index| ledger.entry(index).unwrap().encode().unwrap())
        .collect()
}

/// A ledger with its entries in a store, in four groups, and a folder for another one.
struct Grown {
    memory: Memory,
    dir: TempDir,
    other: TempDir,
}

impl Grown {
    fn new() -> Self {
        let grown = Self {
            memory: Memory::default(),
            dir: tempfile::tempdir().unwrap(),
            other: tempfile::tempdir().unwrap(),
        };
        founded(grown.dir());
        let mut ledger = grown.memory.open(grown.dir()).unwrap();
        for nodes in [0..1, 1..4, 4..6] {
            grow(&mut ledger, nodes);
        }
        grown
    }

    fn dir(&self) -> &Path {
        self.dir.path()
    }

    /// The folder of another aggregator.
    fn other(&self) -> PathBuf {
        self.other.path().join("ledger")
    }

    /// The other aggregator ends like this, and its folder stays as it is.
    #[track_caller]
    fn refuses(&self, words: &str) -> LedgerError {
        let held = folder::read_checkpoint(&self.other()).unwrap();
        let groups = self.memory.groups();
        let refused = self.memory.open(&self.other()).map(drop).unwrap_err();
        assert!(refused.to_string().contains(words), "{refused}");
        assert_eq!(folder::read_checkpoint(&self.other()).unwrap(), held);
        assert_eq!(self.memory.groups(), groups);
        refused
    }
}

#[test]
fn the_names_of_groups_are_in_the_order_of_their_entries() {
    let firsts = [0, 1, 9, 10, 99, 12_345, u64::MAX];
    let names = firsts.map(group_name);
    assert!(names.is_sorted(), "{names:?}");
    assert_eq!(names[5], "00000000000000012345");
    assert_eq!(
        names.each_ref().map(|name| group_of(name)),
        firsts.map(Some)
    );
    for other in [
        "",
        "1",
        "+0000000000000000001",
        "network",
        "00000000000000012345.a",
    ] {
        assert_eq!(group_of(other), None, "{other:?}");
    }
}

#[test]
fn an_object_holds_entries_and_checkpoints() {
    let entries = [
        StoredEntry {
            bytes: vec![1, 2],
            checkpoint: None,
        },
        StoredEntry {
            bytes: Vec::new(),
            checkpoint: Some(vec![3]),
        },
    ];
    let object = encode(&entries);
    let expected = "01020000000200000001020000000000010100000003";
    assert_eq!(hex::encode(&object), expected);
    assert_eq!(decode(&object).unwrap(), entries);
    let longer = [&object[..], &[0]].concat();
    for wrong in [&object[..object.len() - 1], &longer, &[], &[2]] {
        assert!(decode(wrong).is_err(), "{wrong:?}");
    }
}

#[test]
fn what_is_acknowledged_is_in_the_store() {
    let grown = Grown::new();
    let firsts: Vec<_> = grown.memory.groups().into_keys().collect();
    assert_eq!(firsts, [0, 1, 2, 5]);
    assert_eq!(grown.memory.entries(), entries(grown.dir()));
}

#[test]
fn an_empty_folder_is_filled_from_the_store() {
    let grown = Grown::new();
    let mut ledger = grown.memory.open(&grown.other()).unwrap();
    assert_eq!(
        Some(ledger.checkpoint().to_vec()),
        folder::read_checkpoint(grown.dir()).unwrap()
    );
    grow(&mut ledger, 6..8);
    drop(ledger);
    assert_eq!(entries(&grown.other())[..7], entries(grown.dir()));
    assert_eq!(entries(&grown.other()), grown.memory.entries());
    let report = replay(&grown.other(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    // The first machine is back, and catches up.
    drop(grown.memory.open(grown.dir()).unwrap());
    assert_eq!(entries(grown.dir()), grown.memory.entries());
}

/// A writer that is killed has perhaps stored one group more than it has on disk.
#[test]
fn a_folder_that_is_behind_catches_up_from_within_a_group() {
    let grown = Grown::new();
    let whole = entries(grown.dir());
    for held in 1..=whole.len() {
        let other = tempfile::tempdir().unwrap();
        founded(other.path());
        // The same entries, in groups of one.
        let mut ledger = Ledger::open(other.path(), None, log_key()).unwrap();
        for node in 0..held as u8 - 1 {
            grow(&mut ledger, node..node + 1);
        }
        drop(ledger);
        drop(grown.memory.open(other.path()).unwrap());
        assert_eq!(entries(other.path()), whole, "{held}");
    }
    assert_eq!(grown.memory.entries(), whole);
}

#[test]
fn a_store_that_is_behind_is_filled_from_the_folder() {
    let grown = Grown::new();
    let whole = entries(grown.dir());
    for groups in 0..=4 {
        let memory = Memory::default();
        let some = grown.memory.groups().into_iter().take(groups).collect();
        memory.change(|kept| kept.groups = some);
        drop(memory.open(grown.dir()).unwrap());
        assert_eq!(memory.entries(), whole, "{groups}");
        let other = tempfile::tempdir().unwrap();
        drop(memory.open(other.path()).unwrap());
        assert_eq!(entries(other.path()), whole, "{groups}");
    }
}

#[test]
fn of_two_writers_the_later_one_records_nothing() {
    let grown = Grown::new();
    copy(grown.dir(), &grown.other());
    let mut first = grown.memory.open(grown.dir()).unwrap();
    let mut second = grown.memory.open(&grown.other()).unwrap();
    grow(&mut first, 6..7);
    let size = second.size();
    for _ in 0..2 {
        let fenced = second.append_all(T0 + 1, vec![enrolled(7), enrolled(8)]);
        let is_other =
            matches!(fenced, Err(LedgerError::OtherEntries { index, .. }) if index == size);
        assert!(is_other, "{fenced:?}");
        assert!(second.check_writable().is_err());
        assert_eq!(second.size(), size);
    }
    drop(second);
    assert_eq!(entries(&grown.other()).len() as u64, size);
    // It may go on where the other one stopped.
    grow(&mut grown.memory.open(&grown.other()).unwrap(), 8..9);
    let fenced = first.append_all(T0 + 1, vec![enrolled(9)]);
    assert!(matches!(fenced, Err(LedgerError::OtherEntries { .. })));
    drop(first);
    assert_eq!(entries(&grown.other()), grown.memory.entries());
}

/// The answer of the store was lost, and the group is there.
#[test]
fn a_writer_takes_its_own_group_for_its_own() {
    let grown = Grown::new();
    let mut ledger = grown.memory.open(grown.dir()).unwrap();
    grown
        .memory
        .change(|kept| (kept.failures, kept.late) = (1, true));
    grow(&mut ledger, 6..8);
    drop(ledger);
    assert_eq!(grown.memory.entries(), entries(grown.dir()));
}

#[test]
fn an_append_waits_for_a_store_that_is_away() {
    let grown = Grown::new();
    let mut ledger = grown.memory.open(grown.dir()).unwrap();
    let told = Arc::new(Mutex::new(Vec::new()));
    let telling = told.clone();
    ledger.watch_store(move |failed| {
        let why = failed.map(|error| error.why.clone());
        telling.lock().unwrap().push(why);
    });
    grown.memory.change(|kept| kept.failures = 1);
    grow(&mut ledger, 6..7);
    assert_eq!(*told.lock().unwrap(), [Some("away".to_owned()), None]);
    drop(ledger);
    assert_eq!(grown.memory.entries(), entries(grown.dir()));
}

#[test]
fn a_folder_with_another_history_is_refused() {
    let grown = Grown::new();
    copy(grown.dir(), &grown.other());
    grow(&mut grown.memory.open(grown.dir()).unwrap(), 6..7);
    let mut ledger = Ledger::open(&grown.other(), None, log_key()).unwrap();
    grow(&mut ledger, 7..8);
    drop(ledger);
    let refused = grown.refuses("another aggregator writes the same log");
    assert!(matches!(
        refused,
        LedgerError::OtherEntries { index: 7, .. }
    ));
    // The other histories end before the newest group.
    grow(&mut grown.memory.open(grown.dir()).unwrap(), 8..9);
    let mut ledger = Ledger::open(&grown.other(), None, log_key()).unwrap();
    grow(&mut ledger, 9..11);
    drop(ledger);
    assert!(grown.refuses("memory").is_of_stored_entries());
}

#[test]
fn a_store_without_entries_fills_no_folder() {
    let mut grown = Grown::new();
    grown.memory = Memory::default();
    let refused = grown.refuses("holds no entries of one");
    assert!(matches!(refused, LedgerError::NoEntries { .. }));
    assert!(!grown.other().exists());
}

#[test]
fn the_log_of_another_key_fills_no_folder() {
    let grown = Grown::new();
    let refused = grown.memory.open_as(&grown.other(), key(0)).map(drop);
    let network = genesis().network_id();
    let is_other = matches!(refused, Err(LedgerError::EntriesOfOther { network: found, .. }) if found == network);
    assert!(is_other, "{refused:?}");
    assert!(!grown.other().exists());
}

#[test]
fn a_store_with_a_gap_is_refused() {
    let grown = Grown::new();
    let whole = grown.memory.groups();
    for gap in [0, 1, 2] {
        grown.memory.change(|kept| {
            kept.groups = whole.clone();
            kept.groups.remove(&gap);
        });
        let refused = grown.memory.open(&grown.other()).map(drop).unwrap_err();
        let words = format!("lacks the object `entries/{}`", group_name(gap));
        assert!(refused.to_string().contains(&words), "{refused}");
        assert!(refused.is_of_stored_entries());
    }
}

/// A folder that has only the genesis, beside a store with this in place of the last group.
#[track_caller]
fn does_not_continue(change: impl FnOnce(&mut Vec<StoredEntry>), words: &str) {
    let grown = Grown::new();
    founded(&grown.other());
    grown.memory.change(|kept| {
        let last = kept.groups.get_mut(&5).unwrap();
        let mut entries = decode(last).unwrap();
        change(&mut entries);
        *last = encode(&entries);
    });
    let refused =
        grown.refuses("`entries/00000000000000000005` in the blob store memory does not continue");
    assert!(refused.to_string().contains(words), "{refused}");
    assert!(refused.is_of_stored_entries());
}

#[test]
fn entries_that_the_log_has_not_signed_are_refused() {
    // The last byte of a name.
    let changed = |entries: &mut Vec<StoredEntry>| *entries[0].bytes.last_mut().unwrap() ^= 1;
    does_not_continue(changed, "it signs root");
    does_not_continue(|entries| entries.swap(0, 1), "it signs root");
    does_not_continue(Vec::clear, "does not end with a checkpoint");
    does_not_continue(
        |entries| entries[1].checkpoint = None,
        "does not end with a checkpoint",
    );
    does_not_continue(
        |entries| entries[1].checkpoint.as_mut().unwrap()[60] ^= 1,
        "",
    );
}

#[test]
fn an_object_of_something_else_is_refused() {
    let grown = Grown::new();
    grown
        .memory
        .change(|kept| kept.groups.insert(5, b"else".to_vec()));
    founded(&grown.other());
    grown.refuses("it is of version 101, not 1");
    grown.memory.change(|kept| {
        let group = kept.groups[&2].clone();
        kept.groups.insert(4, group);
        kept.groups.remove(&5)
    });
    grown.refuses("it begins before the group before it ends");
    fs::remove_dir_all(grown.other()).unwrap();
    grown
        .memory
        .change(|kept| kept.groups.insert(0, encode(&[])));
    grown.refuses("does not begin with a genesis and its checkpoint");
    assert!(!grown.other().exists());
}

#[test]
fn a_genesis_that_the_log_has_not_signed_fills_no_folder() {
    let grown = Grown::new();
    grown.memory.change(|kept| {
        let mut entries = decode(&kept.groups[&0]).unwrap();
        entries[0].checkpoint.as_mut().unwrap()[60] ^= 1;
        kept.groups.insert(0, encode(&entries));
    });
    grown.refuses("`entries/00000000000000000000` in the blob store memory does not continue");
    assert!(!grown.other().exists());
}

#[test]
fn a_checkpoint_from_which_something_follows_has_to_be_there() {
    let grown = Grown::new();
    let memory = Memory::default();
    let dir = tempfile::tempdir().unwrap();
    drop(ledger_with_a_round(dir.path()));
    drop(memory.open(dir.path()).unwrap());
    let object = memory.groups()[&0].clone();
    let mut entries = decode(&object).unwrap();
    let needed = entries.iter_mut().find(|stored| {
        let entry = Entry::decode(&stored.bytes).unwrap();
        needs_checkpoint(&entry.body)
    });
    needed.unwrap().checkpoint = None;
    memory.change(|kept| kept.groups.insert(0, encode(&entries)));
    let refused = memory.open(&grown.other()).map(drop).unwrap_err();
    assert!(refused.is_of_stored_entries(), "{refused}");
    assert!(refused.to_string().contains(" is missing"), "{refused}");
}

/// Its checkpoint shows what it had, and the store may have less.
#[test]
fn a_folder_that_has_lost_its_database_is_not_filled() {
    let grown = Grown::new();
    copy(grown.dir(), &grown.other());
    fs::remove_dir_all(folder::database(&grown.other())).unwrap();
    let refused = grown.refuses("there is no ledger in");
    assert!(matches!(refused, LedgerError::NoLedger(_)));
}

/// There, two aggregators would both go on.
#[test]
fn a_store_that_overwrites_is_refused() {
    let grown = Grown::new();
    grown.memory.change(|kept| kept.overwrites = true);
    let refused = grown.memory.open(grown.dir()).map(drop);
    assert!(
        matches!(refused, Err(LedgerError::NoFence(_))),
        "{refused:?}"
    );
}

/// A plan that deletes nothing, and states that updates of rounds before this one are not kept.
fn pruning(ledger: &Ledger, updates_before: u64) -> PrunePlan {
    PrunePlan {
        entries: ledger.size(),
        closed: 0,
        first_kept: updates_before,
        longer: None,
        doomed: Vec::new(),
        kept: (0, 0),
        statement: Some(Pruning {
            network: *ledger.state().network(),
            operator: NodeId(ledger.state().genesis().log_key),
            entries: ledger.size(),
            updates_before,
            proofs_before: 0,
            weights_before: 0,
        }),
    }
}

#[test]
fn what_was_pruned_is_known_in_an_empty_folder() {
    let grown = Grown::new();
    let ledger = grown.memory.open(grown.dir()).unwrap();
    let plan = pruning(&ledger, 3);
    plan.carry_out(&ledger).unwrap();
    drop(ledger);
    drop(grown.memory.open(&grown.other()).unwrap());
    let read = |dir: &Path| pruned::read(dir, &genesis()).unwrap();
    assert_eq!(read(&grown.other()), plan.statement);
    // A store that lacks it gets it from the folder.
    grown.memory.change(|kept| kept.pruned = None);
    drop(grown.memory.open(grown.dir()).unwrap());
    assert!(grown.memory.change(|kept| kept.pruned.is_some()));
}

#[test]
fn who_knows_less_of_what_was_pruned_deletes_nothing() {
    let grown = Grown::new();
    let ours = grown.memory.open(grown.dir()).unwrap();
    let theirs = grown.memory.open(&grown.other()).unwrap();
    pruning(&ours, 3).carry_out(&ours).unwrap();
    let stored = grown.memory.change(|kept| kept.pruned.clone());
    let refused = pruning(&theirs, 2).carry_out(&theirs);
    assert!(
        matches!(refused, Err(LedgerError::PrunedElsewhere(_))),
        "{refused:?}"
    );
    assert_eq!(grown.memory.change(|kept| kept.pruned.clone()), stored);
    assert_eq!(pruned::read(&grown.other(), &genesis()).unwrap(), None);
}
