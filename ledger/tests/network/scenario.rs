//! The writer in tests that kill it, fail its writes or cut off the power. It makes every kind of write that a ledger makes, and prints
//! on standard output what it has acknowledged.

use super::log::{log_vkey, ORIGIN};
use super::*;
use std::io::{IoSlice, Write};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use zk0_circuits::Digest;
use zk0_ledger::witness_store::{hash, AddError, WitnessError, WitnessStore};
use zk0_ledger::{Blobs, Ledger, LedgerError};
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::tlog::witness::AddCheckpoint;
use zk0_protocol::{Body, Checkpoint, Receipt};

/// The environment variable that names the folder to the child process.
pub const FOLDER: &str = "ZK0_TEST_SCENARIO_IN";

/// How many entries the whole scenario appends.
pub const ENTRIES: usize = 64;

/// The exit code of a child that stopped as it should after a failed write.
pub const STOPPED: i32 = 3;

/// Writes the line to standard output at once. It uses `writev`, which a ledger does not use, so that the tests can tell it apart.
fn tell(line: String) {
    let stdout = std::io::stdout();
    let file = std::fs::File::from(stdout.as_fd().try_clone_to_owned().unwrap());
    let line = format!("{line}\n");
    let written = (&file)
        .write_vectored(&[IoSlice::new(line.as_bytes())])
        .unwrap();
    assert_eq!(written, line.len());
}

fn acknowledge(receipt: &Receipt) {
    let receipt = borsh::to_vec(receipt).unwrap();
    tell(format!("acknowledged {}", hex::encode(receipt)));
}

/// This is not a test of its own. The child processes of other tests run it. It runs the whole scenario in the folder that the environment
/// names, and ends the process. Without a folder, it does nothing.
#[test]
#[ignore = "run by other tests as a child process"]
fn the_scenario() {
    let Some(dir) = std::env::var_os(FOLDER) else {
        return;
    };
    // The test harness prints before this, so the word is on a line of its own.
    tell("\nbegun".into());
    match scenario(Path::new(&dir)) {
        Ok(()) => std::process::exit(0),
        Err(error) => {
            tell(format!("failed {error}"));
            std::process::exit(STOPPED)
        }
    }
}

/// After a failed write, the ledger must not write again, and it has to state it.
fn attempt(
    ledger: &mut Ledger,
    append: impl Fn(&mut Ledger) -> Result<Vec<Receipt>, LedgerError>,
) -> Result<(), LedgerError> {
    let before = ledger.size();
    match append(ledger) {
        Ok(receipts) => {
            receipts.iter().for_each(acknowledge);
            Ok(())
        }
        Err(error) => {
            // Reading a receipt may also fail after the entries were recorded.
            if ledger.size() == before {
                match append(ledger) {
                    Err(LedgerError::Poisoned) => {}
                    other => tell(format!("NOT POISONED by {error}: {other:?}")),
                }
            }
            Err(error)
        }
    }
}

/// The witness of the scenario. Its folder lies beside the ledger's.
fn witness(dir: &Path) -> Result<WitnessStore, WitnessError> {
    let cosigner = Cosigner::new("witness.example/w", key(90)).unwrap();
    WitnessStore::open(&dir.with_file_name("witness"), cosigner, vec![log_vkey()])
}

/// Has a new witness cosign the checkpoint.
fn cosign(dir: &Path, checkpoint: &[u8]) -> Result<(), AddError> {
    let request = AddCheckpoint {
        old: 0,
        proof: Vec::new(),
        checkpoint: checkpoint.to_vec(),
    };
    witness(dir)?.add(&request.encode(), T0 / 1000)?;
    tell("cosigned".into());
    Ok(())
}

/// The name of a folder in which the scenario keeps its database in plain files.
pub const PLAIN: &str = "plain";

fn scenario(dir: &Path) -> Result<(), LedgerError> {
    if dir.ends_with(PLAIN) {
        let failed = |error| LedgerError::Io {
            path: dir.into(),
            error,
        };
        plain_files(dir).map_err(failed)?;
    }
    let (mut ledger, receipt) = Ledger::create(dir, genesis(), log_key(), T0)?;
    acknowledge(&receipt);
    let network = *ledger.state().network();
    for node in 0..2 {
        attempt(&mut ledger, |ledger| {
            let body = enrolled(node);
            Ok(vec![ledger.append(T0 + 1, body)?])
        })?;
    }
    attempt(&mut ledger, |ledger| {
        ledger.append_all(
            T0 + 2,
            (0..2).map(|node| registered(&network, node)).collect(),
        )
    })?;
    let digest = ledger.blobs().put(&[7; 200_000])?;
    tell(format!("blob {digest}"));
    cosign(dir, ledger.checkpoint()).map_err(|error| match error {
        AddError::Failed(WitnessError::Io { path, error }) => LedgerError::Io { path, error },
        other => panic!("{other}"),
    })?;
    attempt(&mut ledger, |ledger| {
        let opening = Body::RoundOpened(opened(ledger.state(), T0 + 3));
        Ok(vec![ledger.append(T0 + 3, opening)?])
    })?;
    attempt(&mut ledger, |ledger| {
        let commit = |node| committed(ledger.state(), node, weights(0x10 + node));
        let group = vec![enrolled(5), commit(0), enrolled(6), commit(1), enrolled(7)];
        ledger.append_all(T0 + 4, group)
    })?;
    attempt(&mut ledger, |ledger| {
        let closing = Body::CommitmentsClosed(commitments_closed(ledger.state()));
        let closing = ledger.append(T0 + 4, closing)?;
        let drawing = Body::RandomnessDrawn(drawn(ledger.state()));
        Ok(vec![closing, ledger.append(T0 + 4, drawing)?])
    })?;
    drop(ledger);
    // Opening the ledger writes, too.
    let mut ledger = Ledger::open(dir, Some(&network), log_key())?;
    attempt(&mut ledger, |ledger| {
        ledger.append_all(T0 + 5, (10..60).map(enrolled).collect())
    })?;
    attempt(&mut ledger, |ledger| {
        Ok(vec![ledger.append(T0 + 6, enrolled(60))?])
    })?;
    Ok(())
}

/// Runs the scenario in `dir`, as a child of this test binary, and of `wrapper` if there is one.
pub fn child(dir: &Path, wrapper: &[String]) -> Output {
    let this = std::env::current_exe().unwrap();
    let mut command = match wrapper {
        [] => Command::new(this),
        [program, arguments @ ..] => {
            let mut command = Command::new(program);
            command.args(arguments).arg(this);
            command
        }
    };
    command
        .args(["--exact", "network::scenario::the_scenario"])
        .args(["--ignored", "--nocapture"])
        .args(["--test-threads", "1"])
        .env(FOLDER, dir)
        .output()
        .unwrap()
}

/// Makes a folder in memory if possible, because thousands of syncs take long on a disk.
pub fn scratch() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    match tempfile::tempdir_in(memory) {
        Ok(dir) => dir,
        Err(_) => tempfile::tempdir().unwrap(),
    }
}

/// What a child stated.
#[derive(Debug, Default)]
pub struct Said {
    /// Whether the program got as far as the scenario.
    pub begun: bool,
    pub receipts: Vec<Receipt>,
    pub blobs: Vec<Digest>,
    /// Whether the witness has cosigned.
    pub cosigned: bool,
}

/// Reads what a child stated. Its last line may be incomplete.
pub fn reported(stdout: &[u8]) -> Said {
    let mut reported = Said::default();
    for line in String::from_utf8_lossy(stdout).split_inclusive('\n') {
        assert!(!line.contains("NOT POISONED"), "{line}");
        let Some(line) = line.strip_suffix('\n') else {
            continue;
        };
        reported.begun |= line == "begun";
        reported.cosigned |= line == "cosigned";
        if let Some(receipt) = line.strip_prefix("acknowledged ") {
            reported
                .receipts
                .push(borsh::from_slice(&hex::decode(receipt).unwrap()).unwrap());
        } else if let Some(digest) = line.strip_prefix("blob ") {
            reported.blobs.push(digest.parse().unwrap());
        }
    }
    reported
}

/// Checks a folder that a writer left behind: all that it acknowledged is there, what it signed is one history, and another
/// writer goes on with it. Returns how many entries there are.
pub fn check(dir: &Path, reported: &Said, when: &str) -> u64 {
    let published = std::fs::read(dir.join("checkpoint")).ok();
    let mut ledger = match Ledger::open(dir, None, log_key()) {
        Ok(ledger) => ledger,
        // Nothing was acknowledged. Then the folder need not hold a ledger, but one can be founded there.
        Err(error) if reported.receipts.is_empty() && published.is_none() => {
            match Ledger::create(dir, genesis(), log_key(), T0) {
                Ok((ledger, _)) => ledger,
                Err(again) => panic!("{when}: {error}, and it cannot be founded again: {again}"),
            }
        }
        Err(error) => panic!("{when}: {error}"),
    };
    for receipt in &reported.receipts {
        let (_, entry) = receipt.verify(&genesis().log_key, &genesis().name).unwrap();
        assert_eq!(ledger.entry(receipt.index).unwrap(), entry, "{when}");
        assert_eq!(
            &ledger.first_receipt(receipt.index).unwrap(),
            receipt,
            "{when}"
        );
    }
    if let Some(text) = published {
        let signed = Checkpoint::open(&text, &genesis().name, &genesis().log_key)
            .unwrap_or_else(|error| panic!("{when}: {error}"));
        let covered = signed.size - 1;
        let receipt = ledger.receipt_at(signed.size, covered).unwrap();
        assert_eq!(receipt.checkpoint, text, "{when}");
    }
    for digest in &reported.blobs {
        Blobs::at(dir).check(digest).unwrap();
    }
    if reported.cosigned {
        let witness = witness(dir).unwrap_or_else(|error| panic!("{when}: {error}"));
        let last = witness.last(&hash(ORIGIN)).unwrap();
        assert!(
            last.is_some(),
            "{when}: the witness forgot what it cosigned"
        );
    }
    ledger.append(T0 + 7, enrolled(99)).unwrap();
    let size = ledger.size();
    drop(ledger);
    let report = zk0_ledger::replay(dir, None, &mut ());
    assert_eq!(
        (report.verdict, report.entries),
        (zk0_ledger::replay::Verdict::Verified, size),
        "{when}: {:?}",
        report.findings
    );
    size
}

/// `strace`, or `None` after saying how to get it.
pub fn strace() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let found = std::env::split_paths(&path)
        .map(|dir| dir.join("strace"))
        .find(|file| file.is_file());
    if found.is_none() {
        zk0_testkit::skipped::skipped("there is no strace; scripts/setup.sh guest installs it");
    }
    found
}
