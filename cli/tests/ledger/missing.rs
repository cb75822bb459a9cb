//! Files that a ledger lacks: those that its open round cannot close without are named, and a backup gives them back.

use super::{a_blob_of, audit, fails};
use crate::harness::made_ledger::Made;
use crate::harness::{copy, ends, printed, prints, text, zk0, LEDGER};
use ed25519_dalek::SigningKey;
use std::fs;
use std::path::Path;
use zk0_ledger::Ledger;
use zk0_protocol::RefusalCode;

/// Runs a command that has to end as one does where files of the open round are missing. Returns what it names.
#[track_caller]
fn misses(arguments: &[&str]) -> Vec<String> {
    let reported = printed(&ends(5, zk0(arguments)));
    assert!(reported.contains("round 0 cannot close"), "{reported}");
    let missing = reported
        .lines()
        .filter_map(|line| line.strip_prefix("MISSING"));
    missing.map(|line| line.trim().to_owned()).collect()
}

/// A ledger that accepts contributions whose updates were never there.
fn accepting(dir: &Path) -> Made {
    let mut made = Made::found(dir, 1);
    made.lie = Some(RefusalCode::MalformedProof);
    made
}

#[test]
fn missing_files_of_accepted_contributions_are_named_while_their_round_is_open() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved, mirror) = (at("ledger"), at("saved"), at("mirror"));
    let mut made = accepting(&dir);
    made.decided_round();
    let open = made.ledger.state().round().unwrap();
    let mut expected: Vec<_> = [0, 1].map(Made::id).into();
    expected.sort();
    let expected: Vec<_> = expected
        .iter()
        .map(|node| {
            let update = open.commits[node].update.blob;
            format!("the update {update} of node {node}, whose contribution to the open round 0 is accepted")
        })
        .collect();
    drop(made.ledger);
    let fsck = ["ledger", "fsck", text(&dir)];
    assert_eq!(misses(&fsck), expected);
    prints(&["ledger", "backup", text(&dir), text(&saved)]);
    let restore = ["ledger", "restore", text(&saved)];
    let newest = ["--checkpoint", text(&dir)];
    let again = at("again");
    assert_eq!(
        misses(&[&restore[..], &[text(&again)], &newest].concat()),
        expected
    );
    // The proofs of an open round are not public.
    let import = ["ledger", "import", text(&dir), text(&mirror)];
    let missing = misses(&import);
    assert!(expected.iter().all(|line| missing.contains(line)));
    assert_eq!(missing.len(), 4, "{missing:?}");
    assert!(missing.iter().any(|line| line.starts_with("the proof")));
    // They come back from the backup, and the aggregator may run meanwhile.
    let key = SigningKey::from_bytes(&[7; 32]);
    let _writer = Ledger::open(&mirror, None, key).unwrap();
    let in_place = [
        "ledger",
        "restore",
        text(&saved),
        text(&mirror),
        "--in-place",
    ];
    assert_eq!(misses(&in_place), expected);
    // A file that is in the store is not missing.
    let store = at("store");
    let kept = store.join("blobs/sha256");
    fs::create_dir_all(&kept).unwrap();
    for line in &expected {
        let digest = line.split(' ').nth(2).unwrap();
        fs::write(kept.join(digest), b"update").unwrap();
    }
    let store = format!("file://{}", store.display());
    prints(&[&fsck[..], &["--blob-store", &store]].concat());
    // A round that has closed needs no file.
    let closed = at("closed");
    accepting(&closed).round();
    prints(&["ledger", "fsck", text(&closed)]);
}

#[test]
fn what_a_ledger_lacks_comes_from_a_backup_and_nothing_else_is_changed() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved) = (at("ledger"), at("backup"));
    copy(Path::new(LEDGER), &dir);
    prints(&["ledger", "backup", text(&dir), text(&saved)]);
    let original = audit(LEDGER);
    let blob = a_blob_of(&dir);
    fs::remove_file(&blob).unwrap();
    let restore = ["ledger", "restore", text(&saved), text(&dir), "--in-place"];
    let reported = prints(&restore);
    assert!(reported.contains("0 of them new; 1 blob new"), "{reported}");
    assert!(prints(&restore).contains("; 0 blobs new"));
    assert_eq!(audit(text(&dir)), original);
    // What is damaged in the backup stays there.
    fs::remove_file(&blob).unwrap();
    let copied = saved.join("blobs/sha256").join(blob.file_name().unwrap());
    fs::write(&copied, b"changed").unwrap();
    fails(&restore, "1 damaged blob");
    assert!(!blob.exists());
    let other = at("other");
    drop(Made::found(&other, 1));
    let restore = [
        "ledger",
        "restore",
        text(&saved),
        text(&other),
        "--in-place",
    ];
    fails(&restore, "is of network");
}
