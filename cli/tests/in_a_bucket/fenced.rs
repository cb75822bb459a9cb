//! The log's entries in the store fence aggregators off from each other, and fill an empty folder.

use super::{founded, serving};
use crate::harness::drill::Drill;
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{as_in_the_runbook, copy, ends, fails, logged, logs, words, zk0};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::TempDir;
use zk0::keys;
use zk0_audit::verified_entries::verified_entries;
use zk0_ledger::blobs::entry_objects::group_name;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_testkit::until;

/// How soon an aggregator ends that is fenced off.
const SOON: Duration = Duration::from_millis(100);

/// A network with a store in a folder, and some rounds.
struct Kept {
    network: LocalNetwork,
    store: TempDir,
}

impl Kept {
    fn start() -> Self {
        let kept = Self {
            network: founded(),
            store: tempfile::tempdir().unwrap(),
        };
        let arguments = kept.serving("ledger", &["--rounds", "2"]);
        let mut aggregator = Serving::start(&words(&arguments));
        kept.network.closes(2);
        assert!(aggregator.terminate().success());
        kept
    }

    fn address(&self) -> String {
        format!("file://{}", self.store.path().display())
    }

    /// The command that serves the ledger in this folder of the network.
    fn serving(&self, ledger: &str, more: &[&str]) -> Vec<String> {
        let address = self.address();
        let more = [&["--blob-store", &*address][..], more].concat();
        let mut arguments = serving(&self.network, &more);
        arguments[2] = self.network.path(ledger);
        arguments
    }

    /// The log of an aggregator that does not serve the ledger in this folder.
    #[track_caller]
    fn refuses(&self, code: i32, ledger: &str) -> String {
        logged(&ends(code, zk0(&words(&self.serving(ledger, &[])))))
    }

    fn entries(&self, ledger: &str) -> Vec<Entry> {
        verified_entries(Path::new(&self.network.path(ledger)))
            .unwrap()
            .0
    }

    /// The object of the group that begins with this entry.
    fn object(&self, first: u64) -> PathBuf {
        self.store.path().join("entries").join(group_name(first))
    }
}

#[test]
fn an_empty_folder_goes_on_from_the_store() {
    let kept = Kept::start();
    let whole = kept.entries("ledger");
    let arguments = kept.serving("other", &["--rounds", "3"]);
    let mut aggregator = Serving::start(&words(&arguments));
    until("another round closes", || {
        let entries = kept.entries("other").into_iter();
        let closed = entries.filter(|entry| matches!(entry.body, Body::RoundClosed(_)));
        closed.count() == 3
    });
    assert!(aggregator.terminate().success());
    assert_eq!(kept.entries("other")[..whole.len()], whole);
    // The first machine is back, behind the store.
    let arguments = kept.serving("ledger", &["--rounds", "3"]);
    let mut aggregator = Serving::start(&words(&arguments));
    assert!(aggregator.terminate().success());
    assert_eq!(kept.entries("ledger"), kept.entries("other"));
}

#[test]
fn of_two_aggregators_on_copies_of_a_folder_one_ends() {
    let kept = Kept::start();
    let [ledger, other] = ["ledger", "other"].map(|name| kept.network.path(name));
    copy(Path::new(&ledger), Path::new(&other));
    let drill = Drill::begin("two aggregators run on copies of a folder");
    // Their rounds open and close by themselves.
    let serve = |name| Serving::start(&words(&kept.serving(name, &[])));
    let mut both = ["ledger", "other"].map(serve);
    let fenced = until("one of them ends", || {
        let mut ended = both.iter_mut().map(|one| one.ended_within(SOON));
        ended.position(|ended| ended.is_some_and(|ended| ended.code() == Some(2)))
    });
    let reported = both[fenced].log();
    as_in_the_runbook(&reported, "so another aggregator writes the same log");
    let goes_on = &mut both[1 - fenced];
    assert!(goes_on.ended_within(SOON).is_none());
    assert!(goes_on.terminate().success());
    // What the fenced one has is the beginning of what the other one has.
    let all = ["ledger", "other"].map(|name| kept.entries(name));
    let (short, long) = (&all[fenced], &all[1 - fenced]);
    assert!(short.len() < long.len());
    assert_eq!(long[..short.len()], short[..]);
    drill.passed();
}

#[test]
fn a_folder_with_another_history_is_not_served() {
    let kept = Kept::start();
    let [ledger, other, key] = ["ledger", "other", "log.key"].map(|name| kept.network.path(name));
    copy(Path::new(&ledger), Path::new(&other));
    // Without the store, both go on.
    for (dir, byte) in [(&ledger, "11"), (&other, "22")] {
        let node = format!("bob={}", byte.repeat(32));
        logs(&["aggregator", "enrol", dir, "--key", &key, "--node", &node]);
    }
    let arguments = kept.serving("ledger", &["--rounds", "2"]);
    assert!(Serving::start(&words(&arguments)).terminate().success());
    let before = kept.entries("other");
    let reported = kept.refuses(2, "other");
    as_in_the_runbook(&reported, "so another aggregator writes the same log");
    assert_eq!(kept.entries("other"), before);
    // The folder makes room.
    fs::rename(&other, kept.network.path("other.old")).unwrap();
    let arguments = kept.serving("other", &["--rounds", "2"]);
    assert!(Serving::start(&words(&arguments)).terminate().success());
    assert_eq!(kept.entries("other"), kept.entries("ledger"));
}

#[test]
fn a_store_that_cannot_fill_a_folder_is_named() {
    let mut kept = Kept::start();
    let other = kept.network.path("other");
    let last = kept.entries("ledger").len() as u64 - 1;
    let right = fs::read(kept.object(last)).unwrap();
    // The last byte is of the checkpoint's signature.
    let mut wrong = right.clone();
    *wrong.last_mut().unwrap() ^= 1;
    fs::write(kept.object(last), wrong).unwrap();
    as_in_the_runbook(&kept.refuses(2, "other"), "does not continue the log: ");
    fs::write(kept.object(last), right).unwrap();
    let first = fs::read(kept.object(0)).unwrap();
    fs::remove_file(kept.object(0)).unwrap();
    as_in_the_runbook(&kept.refuses(2, "other"), "and has entries that come later");
    assert!(!Path::new(&other).exists());
    fs::write(kept.object(0), first).unwrap();
    let pruned = kept.store.path().join("pruned");
    fs::write(&pruned, "something else").unwrap();
    let reported = kept.refuses(2, "ledger");
    as_in_the_runbook(
        &reported,
        "is no statement of this log about pruned blobs: ",
    );
    fs::remove_file(pruned).unwrap();

    let [key, log_key] = ["other.key", "log.key"].map(|name| kept.network.path(name));
    keys::generate(Path::new(&key)).unwrap();
    fs::rename(&log_key, kept.network.path("kept.key")).unwrap();
    fs::rename(&key, &log_key).unwrap();
    as_in_the_runbook(&kept.refuses(1, "other"), "is not its log key: ");
    fs::rename(kept.network.path("kept.key"), &log_key).unwrap();

    kept.store = tempfile::tempdir().unwrap();
    as_in_the_runbook(&kept.refuses(1, "other"), "holds no entries of one: ");
    assert!(!Path::new(&other).exists());
    // Without a store, it is as it was.
    let serve = ["aggregator", "serve", &other, "--key", &log_key];
    let reported = fails(&[&serve[..], &["--listen", "127.0.0.1:0"]].concat());
    assert!(reported.contains("there is no ledger in"), "{reported}");
}
