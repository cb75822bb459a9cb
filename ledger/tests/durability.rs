//! Nothing that was acknowledged is lost, and a log never has two histories.

use crate::network::rounds::{copy, ledger_with_a_round};
use crate::network::*;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;
use zk0_circuits::NodeId;
use zk0_ledger::replay::{replay, HistoryFold, Verdict};
use zk0_ledger::{Blobs, Ledger, LedgerError};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Body, Checkpoint, Entry, Genesis, Receipt, State};

const CHILD: &str = "ZK0_TEST_APPEND_IN";

/// This is not a test of its own. The child processes of the tests below run it until they are killed.
#[test]
#[ignore = "run by other tests as a child process"]
fn append_until_killed() {
    let Some(dir) = std::env::var_os(CHILD) else {
        return;
    };
    let mut ledger = Ledger::open(Path::new(&dir), None, log_key()).unwrap();
    loop {
        let mut seed = [0; 32];
        seed[..8].copy_from_slice(&ledger.size().to_le_bytes());
        let key = ed25519_dalek::SigningKey::from_bytes(&seed);
        let enrolled = NodeEnrolled {
            node: NodeId(key.verifying_key().to_bytes()),
            name: "one of many".into(),
        };
        let receipt = ledger.append(T0, Body::NodeEnrolled(enrolled)).unwrap();
        println!(
            "acknowledged {}",
            hex::encode(borsh::to_vec(&receipt).unwrap())
        );
    }
}

/// `cargo test --release -p zk0-ledger --test ledger -- --ignored --nocapture durability::rates`
#[test]
#[ignore = "prints how fast entries are appended and replayed on this machine"]
fn rates() {
    const ENTRIES: u64 = 3000;
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    let network = *ledger.state().network();
    ledger.append(T0, enrolled(0)).unwrap();
    let started = std::time::Instant::now();
    for _ in 0..ENTRIES {
        ledger.append(T0, registered(&network, 0)).unwrap();
    }
    println!(
        "appended {:.0}/s",
        ENTRIES as f64 / started.elapsed().as_secs_f64()
    );
    let started = std::time::Instant::now();
    assert_eq!(replay(dir.path(), None, &mut ()).entries, ENTRIES + 2);
    println!(
        "replayed {:.0}/s",
        ENTRIES as f64 / started.elapsed().as_secs_f64()
    );
}

fn child(dir: &Path) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "durability::append_until_killed",
            "--ignored",
            "--nocapture",
        ])
        .env(CHILD, dir)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Reads the receipts that a killed child printed. Its last line may be incomplete.
fn acknowledged(child: &mut Child) -> Vec<Receipt> {
    BufReader::new(child.stdout.take().unwrap())
        .lines()
        .map_while(Result::ok)
        .filter_map(|line| {
            let receipt = hex::decode(line.strip_prefix("acknowledged ")?).ok()?;
            borsh::from_slice(&receipt).ok()
        })
        .collect()
}

#[test]
fn killed_at_any_moment_it_loses_nothing_acknowledged_and_never_forks() {
    let dir = tempfile::tempdir().unwrap();
    drop(Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap());
    let mut receipts: Vec<Receipt> = Vec::new();
    let mut published: Vec<Vec<u8>> = Vec::new();
    let mut appended = 0;
    for round in 0..12u64 {
        let mut child = child(dir.path());
        // The kill comes at different moments: from before the first append to some hundreds of appends later.
        sleep(Duration::from_millis(20 + (round * 7919) % 331));
        child.kill().unwrap();
        child.wait().unwrap();
        receipts.extend(acknowledged(&mut child));
        published.push(fs::read(dir.path().join("checkpoint")).unwrap());

        let ledger = Ledger::open(dir.path(), None, log_key()).unwrap();
        appended = ledger.size() - 1;
        let mut tree = Frontier::default();
        let roots: Vec<_> = (0..ledger.size())
            .map(|index| {
                tree.push(&ledger.entry(index).unwrap().encode().unwrap())
                    .unwrap();
                tree.root().unwrap()
            })
            .collect();
        for receipt in &receipts {
            assert_eq!(&ledger.first_receipt(receipt.index).unwrap(), receipt);
            let (checkpoint, entry) = receipt.verify(&genesis().log_key, &genesis().name).unwrap();
            assert_eq!(ledger.entry(receipt.index).unwrap(), entry);
            assert_eq!(roots[checkpoint.size as usize - 1], checkpoint.root);
        }
        for text in &published {
            let signed = Checkpoint::open(text, &genesis().name, &genesis().log_key).unwrap();
            assert_eq!(roots[signed.size as usize - 1], signed.root);
        }
    }
    assert!(
        receipts.len() > 20,
        "only {} appends: this tests little",
        receipts.len()
    );
    assert!(receipts.len() as u64 <= appended);
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
}

#[test]
fn one_writer_at_a_time_and_readers_beside_it() {
    let dir = tempfile::tempdir().unwrap();
    let (ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    let second = Ledger::open(dir.path(), None, log_key()).map(drop);
    assert!(matches!(second, Err(LedgerError::Locked(_))), "{second:?}");
    assert_eq!(replay(dir.path(), None, &mut ()).verdict, Verdict::Verified);
    drop(ledger);

    let mut child = child(dir.path());
    let mut seen = 0;
    // The disk may be slow, so the test waits up to a minute while the writer appends.
    let patience = std::time::Instant::now() + std::time::Duration::from_secs(60);
    while std::time::Instant::now() < patience {
        let report = replay(dir.path(), None, &mut ());
        assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
        assert!(report.entries >= seen);
        seen = report.entries;
        if seen > 20 {
            break;
        }
    }
    let other = Ledger::open(dir.path(), None, log_key()).map(drop);
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(seen > 20, "the writer wrote {seen} entries");
    assert!(matches!(other, Err(LedgerError::Locked(_))), "{other:?}");
}

#[test]
fn a_ledger_goes_on_where_it_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let ledger = ledger_with_a_round(dir.path());
    let (state, checkpoint) = (ledger.state().clone(), ledger.checkpoint().to_vec());
    drop(ledger);
    let network = genesis().network_id();
    let mut ledger = Ledger::open(dir.path(), Some(&network), log_key()).unwrap();
    assert_eq!(ledger.state(), &state);
    assert_eq!(ledger.checkpoint(), checkpoint);
    let receipt = ledger.append(T0, enrolled(9)).unwrap();
    assert_eq!(receipt.index, state.entries());
    assert_eq!(
        ledger.state().time_ms(),
        state.time_ms(),
        "the clock went back, the log did not"
    );
}

/// Notes what it is shown, and appends an entry in the name of another process before the ledger is open for writing.
#[derive(Default)]
struct Watcher {
    genesis: u64,
    seen: Vec<u64>,
    writes_at: Option<(u64, PathBuf)>,
}

impl HistoryFold for Watcher {
    fn genesis(&mut self, found: &Genesis) {
        assert_eq!(*found, genesis());
        self.genesis += 1;
    }

    fn entry(&mut self, before: &State, index: u64, _: &Entry) {
        assert_eq!(before.entries(), index);
        self.seen.push(index);
        if let Some((_, dir)) = self.writes_at.take_if(|(at, _)| *at == index) {
            let mut other = Ledger::open(&dir, None, log_key()).unwrap();
            other.append(T0, enrolled(9)).unwrap();
        }
    }
}

#[test]
fn a_fold_takes_each_entry_once_while_a_ledger_is_opened() {
    let dir = tempfile::tempdir().unwrap();
    let size = ledger_with_a_round(dir.path()).size();
    for writes in [false, true] {
        let mut watcher = Watcher {
            writes_at: writes.then(|| (size - 1, dir.path().into())),
            ..Watcher::default()
        };
        let blobs = Blobs::at(dir.path());
        let ledger = Ledger::open_with(dir.path(), None, log_key(), blobs, &mut watcher).unwrap();
        // What another process writes meanwhile is verified, too.
        let entries = size + u64::from(writes);
        assert_eq!(
            (ledger.size(), ledger.state().entries()),
            (entries, entries)
        );
        assert_eq!(watcher.genesis, 1);
        assert_eq!(watcher.seen, (1..entries).collect::<Vec<_>>());
    }
    drop(Ledger::open(dir.path(), None, log_key()).unwrap());
}

#[test]
fn what_the_rules_refuse_is_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    ledger.append(T0, enrolled(0)).unwrap();
    let before = (
        ledger.size(),
        ledger.checkpoint().to_vec(),
        ledger.state().clone(),
    );
    assert!(matches!(
        ledger.append(T0, enrolled(0)),
        Err(LedgerError::Rule(_))
    ));
    let huge = NodeEnrolled {
        node: id(1),
        name: "n".repeat(70_000),
    };
    assert!(matches!(
        ledger.append(T0, Body::NodeEnrolled(huge)),
        Err(LedgerError::Rule(_))
    ));
    assert_eq!(
        before,
        (
            ledger.size(),
            ledger.checkpoint().to_vec(),
            ledger.state().clone()
        )
    );
    assert!(matches!(ledger.entry(2), Err(LedgerError::NoEntry(2))));
}

#[test]
fn killed_before_publishing_it_publishes_on_opening() {
    let dir = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    let file = dir.path().join("checkpoint");
    ledger.append(T0, enrolled(0)).unwrap();
    let older = fs::read(&file).unwrap();
    ledger.append(T0, enrolled(1)).unwrap();
    let newest = fs::read(&file).unwrap();
    drop(ledger);
    fs::write(&file, &older).unwrap();
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Failed);
    drop(Ledger::open(dir.path(), None, log_key()).unwrap());
    assert_eq!(fs::read(&file).unwrap(), newest);
    assert_eq!(replay(dir.path(), None, &mut ()).verdict, Verdict::Verified);

    // Right after the founding, the file may not exist yet.
    let dir = tempfile::tempdir().unwrap();
    drop(Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap());
    let file = dir.path().join("checkpoint");
    let first = fs::read(&file).unwrap();
    fs::remove_file(&file).unwrap();
    drop(Ledger::open(dir.path(), None, log_key()).unwrap());
    assert_eq!(fs::read(&file).unwrap(), first);
}

/// Opening fails and signs nothing, so the folder's checkpoint stays the same.
fn refused(dir: &Path) -> LedgerError {
    let file = dir.join("checkpoint");
    let before = fs::read(&file).ok();
    let error = match Ledger::open(dir, None, log_key()) {
        Err(error) => error,
        Ok(ledger) => panic!("opened with {} entries", ledger.size()),
    };
    assert_eq!(before, fs::read(&file).ok());
    assert_eq!(replay(dir, None, &mut ()).verdict, Verdict::Failed);
    error
}

#[test]
fn a_restored_backup_of_the_database_is_noticed() {
    let dir = tempfile::tempdir().unwrap();
    let backup = tempfile::tempdir().unwrap();
    let (mut ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    ledger.append(T0, enrolled(0)).unwrap();
    drop(ledger);
    copy(&dir.path().join("log"), backup.path());
    let mut ledger = Ledger::open(dir.path(), None, log_key()).unwrap();
    ledger.append(T0, enrolled(1)).unwrap();
    drop(ledger);
    fs::remove_dir_all(dir.path().join("log")).unwrap();
    copy(backup.path(), &dir.path().join("log"));
    let error = refused(dir.path());
    assert!(
        matches!(error, LedgerError::RolledBack { held: 2, signed: 3 }),
        "{error}"
    );
}

#[test]
fn another_history_under_the_signed_checkpoint_is_noticed() {
    let ours = tempfile::tempdir().unwrap();
    let other = tempfile::tempdir().unwrap();
    drop(Ledger::create(ours.path(), genesis(), log_key(), T0).unwrap());
    copy(ours.path(), other.path());
    for (dir, node) in [(ours.path(), 0), (other.path(), 1)] {
        let mut ledger = Ledger::open(dir, None, log_key()).unwrap();
        ledger.append(T0, enrolled(node)).unwrap();
        ledger.append(T0, enrolled(node + 2)).unwrap();
    }
    fs::remove_dir_all(ours.path().join("log")).unwrap();
    copy(&other.path().join("log"), &ours.path().join("log"));
    let error = refused(ours.path());
    assert!(
        matches!(error, LedgerError::Forked { size: 3, .. }),
        "{error}"
    );
}

#[test]
fn a_lost_or_broken_checkpoint_file_is_noticed() {
    let dir = tempfile::tempdir().unwrap();
    drop(ledger_with_a_round(dir.path()));
    let file = dir.path().join("checkpoint");
    let text = fs::read(&file).unwrap();
    fs::remove_file(&file).unwrap();
    assert!(matches!(refused(dir.path()), LedgerError::NoCheckpoint(_)));
    for broken in [
        &b""[..],
        b"nonsense",
        &text[..text.len() - 1],
        &[0xff; 9000],
    ] {
        fs::write(&file, broken).unwrap();
        assert!(matches!(
            refused(dir.path()),
            LedgerError::CheckpointFile { .. }
        ));
    }
}

#[test]
fn the_wrong_folder_or_key_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let open = |network: Option<u8>, key| {
        Ledger::open(dir.path(), network.map(digest).as_ref(), key).map(drop)
    };
    assert!(matches!(
        open(None, log_key()),
        Err(LedgerError::NoLedger(_))
    ));
    drop(ledger_with_a_round(dir.path()));
    assert!(matches!(
        open(Some(1), log_key()),
        Err(LedgerError::OtherNetwork { .. })
    ));
    let report = replay(dir.path(), Some(&digest(1)), &mut ());
    assert_eq!(report.verdict, Verdict::Failed);
    assert!(report.findings[0].text.contains("is of network"));
    assert!(matches!(open(None, key(0)), Err(LedgerError::OtherKey(_))));
    let again = Ledger::create(dir.path(), genesis(), log_key(), T0).map(drop);
    assert!(matches!(again, Err(LedgerError::AlreadyExists(_))));
    let fresh = tempfile::tempdir().unwrap();
    let created = Ledger::create(fresh.path(), genesis(), key(0), T0).map(drop);
    assert!(matches!(created, Err(LedgerError::OtherKey(_))));
    drop(Ledger::create(fresh.path(), genesis(), log_key(), T0).unwrap());
}
