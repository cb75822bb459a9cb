//! `zk0 ledger` and `zk0 audit replay` on the committed ledger, which holds a real proof. The ledger is exported, served and mirrored, and
//! each of these is audited; and an entry is proven offline. Ledgers
//! without real proofs are pruned.

mod kept_rounds;
mod missing;

use crate::harness::made_ledger::Made;
use crate::harness::serving::Serving;
use crate::harness::{self, copy, ends, logged, printed, prints, text, zk0, LEDGER};
use ed25519_dalek::SigningKey;
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use zk0_ledger::{folder, Blobs, Ledger};
use zk0_protocol::tlog::cosigner::Cosigner;

/// Runs a command that has to fail, and to state `words`.
#[track_caller]
fn fails(arguments: &[&str], words: &str) {
    let output = ends(1, zk0(arguments));
    let reported = printed(&output) + &logged(&output);
    assert!(reported.contains(words), "{reported}");
}

/// What an audit states, without the notes.
fn audit(ledger: &str) -> serde_json::Value {
    harness::json(&["audit", "replay", ledger, "--json"])
}

#[test]
fn an_audit_says_the_same_wherever_the_ledger_is_read() {
    let scratch = tempfile::tempdir().unwrap();
    let (out, mirror) = (scratch.path().join("out"), scratch.path().join("mirror"));
    let original = audit(LEDGER);
    let reported = prints(&["ledger", "export", LEDGER, text(&out)]);
    assert!(reported.contains("entries published"), "{reported}");
    assert_eq!(audit(text(&out)), original);
    fails(&["ledger", "fsck", text(&out)], "is an export");
    let nowhere = out.join("nowhere");
    fails(&["ledger", "fsck", text(&nowhere)], "there is no ledger in");
    let serving = Serving::start(&["ledger", "serve", LEDGER, "--listen", "127.0.0.1:0"]);
    assert_eq!(audit(&serving.address), original);
    let network = original["network"].as_str().unwrap();
    let import = [
        "ledger",
        "import",
        &serving.address,
        text(&mirror),
        "--network",
        network,
    ];
    // An earlier import was killed while RocksDB was making the database.
    fs::create_dir_all(mirror.join("log")).unwrap();
    prints(&import);
    assert_eq!(audit(text(&mirror)), original);
    prints(&["ledger", "fsck", text(&mirror)]);
    let other = "00".repeat(32);
    let ours = zk0(&["audit", "replay", text(&out), "--network", &other]);
    let reported = logged(&ends(2, ours));
    assert!(reported.contains("of network"), "{reported}");
    // One blob on disk is changed.
    let blob = fs::read_dir(mirror.join("blobs/sha256"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap();
    fs::write(blob.path(), b"changed").unwrap();
    fails(&["ledger", "fsck", text(&mirror)], "SHA-256");
    // An import that checks what is there fetches it again.
    prints(&import);
    fails(&["ledger", "fsck", text(&mirror)], "SHA-256");
    let reported = prints(&[&import[..], &["--check"]].concat());
    assert!(
        reported.contains("1 blob was damaged; 1 fetched again"),
        "{reported}"
    );
    prints(&["ledger", "fsck", text(&mirror)]);
    let reported = prints(&[&import[..], &["--check"]].concat());
    assert!(
        reported.contains("0 blobs were damaged; 0 fetched"),
        "{reported}"
    );
    // What the export does not have any more is lost.
    let import = ["ledger", "import", text(&out), text(&mirror), "--check"];
    fs::write(blob.path(), b"changed").unwrap();
    let served = out.join("blobs/sha256").join(blob.file_name());
    let whole = fs::read(&served).unwrap();
    fs::remove_file(&served).unwrap();
    fails(&import, "does not have it");
    assert!(!blob.path().exists());
    fs::write(&served, whole).unwrap();
    prints(&import);
    prints(&["ledger", "fsck", text(&mirror)]);
}

#[test]
fn a_backup_is_restored_unless_something_newer_was_signed() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (saved, again) = (at("backup"), at("again"));
    let original = audit(LEDGER);
    let dir = at("ledger");
    copy(Path::new(LEDGER), &dir);
    let reported = prints(&["ledger", "backup", text(&dir), text(&saved)]);
    assert!(reported.contains("backed up"), "{reported}");
    let reported = prints(&["ledger", "backup", text(&dir), text(&saved)]);
    assert!(reported.contains(" 0 of them new"), "{reported}");
    assert_eq!(audit(text(&saved)), original);
    // Without a known checkpoint, and without the option which states that there is none, the command does nothing.
    ends(2, zk0(&["ledger", "restore", text(&saved), text(&again)]));
    assert!(!again.exists());
    let restore = |to: &Path, more: &[&str]| {
        let arguments = [&["ledger", "restore", text(&saved), text(to)], more].concat();
        arguments.into_iter().map(String::from).collect::<Vec<_>>()
    };
    let serving = Serving::start(&["ledger", "serve", LEDGER, "--listen", "127.0.0.1:0"]);
    let restored = restore(
        &again,
        &["--checkpoint", LEDGER, "--checkpoint", &serving.address],
    );
    let restored: Vec<&str> = restored.iter().map(String::as_str).collect();
    let reported = prints(&restored);
    assert!(
        reported.contains("restored to") && !reported.contains("WARNING"),
        "{reported}"
    );
    assert_eq!(audit(text(&again)), original);
    fails(&restored, "is not empty");
    let trusting = at("trusting");
    let trusting = restore(&trusting, &["--no-newer-checkpoint-exists"]);
    let trusting: Vec<&str> = trusting.iter().map(String::as_str).collect();
    let reported = prints(&trusting);
    assert!(reported.contains("WARNING"), "{reported}");
    // This checkpoint belongs to another log.
    let stranger = at("stranger");
    let other = at("other");
    fs::write(
        &other,
        fs::read_to_string(Path::new(LEDGER).join("checkpoint"))
            .unwrap()
            .replacen('\n', "x\n", 1),
    )
    .unwrap();
    let refused = restore(&stranger, &["--checkpoint", text(&other)]);
    let refused: Vec<&str> = refused.iter().map(String::as_str).collect();
    fails(&refused, "known checkpoint");
    assert!(!stranger.exists());
}

#[test]
fn a_ledger_that_no_witness_has_cosigned_yet_is_whole_and_tells_its_key() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, saved) = (scratch.path().join("ledger"), scratch.path().join("backup"));
    let witness = SigningKey::from_bytes(&[55; 32]);
    let witness = Cosigner::new("witness.example/w", witness).unwrap();
    let policy = format!("witness W {} http://127.0.0.1:1\nquorum W\n", witness.key());
    let made = Made::found_with(&dir, 0, [9; 32], policy);
    let key = made.ledger.state().genesis().verifier_key().unwrap();
    drop(made.ledger);
    // The operator of the witness needs the key before the first cosignature.
    let reported = prints(&["ledger", "vkey", text(&dir)]);
    assert_eq!(reported.trim(), key.to_string());
    prints(&["ledger", "backup", text(&dir), text(&saved)]);
    for folder in [&dir, &saved] {
        let reported = prints(&["ledger", "fsck", text(folder)]);
        let note = reported.lines().find(|line| line.starts_with("note  "));
        let waits = note.is_some_and(|note| note.contains("before the witnesses have cosigned"));
        assert!(waits && reported.contains("WHOLE"), "{reported}");
    }
    // What somebody else has put in the place of a cosigned checkpoint is damage.
    fs::write(dir.join("cosigned"), b"cosigned").unwrap();
    fails(&["ledger", "fsck", text(&dir)], "DAMAGED");
}

/// The first blob of a folder in the list of the file system.
fn a_blob_of(dir: &Path) -> PathBuf {
    let mut blobs = fs::read_dir(dir.join("blobs/sha256")).unwrap();
    blobs.next().unwrap().unwrap().path()
}

#[test]
fn a_damaged_blob_ends_a_copy_with_an_error_after_everything_else_is_copied() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved) = (at("ledger"), at("saved"));
    copy(Path::new(LEDGER), &dir);
    prints(&["ledger", "backup", text(&dir), text(&saved)]);
    let checked = ["ledger", "backup", text(&dir), text(&saved), "--check"];
    fs::write(a_blob_of(&saved), b"changed").unwrap();
    let reported = prints(&checked);
    assert!(
        reported.contains("1 blob was damaged in the backup"),
        "{reported}"
    );
    let reported = prints(&checked);
    assert!(!reported.contains("damaged"), "{reported}");
    let blob = a_blob_of(&dir);
    fs::write(&blob, b"changed").unwrap();
    let recorded = folder::read_backed_up(&dir);
    assert!(recorded.is_some());
    for command in ["backup", "export"] {
        let out = at(command);
        let output = ends(1, zk0(&["ledger", command, text(&dir), text(&out)]));
        let log = logged(&output);
        assert!(
            log.contains(text(&blob)) && log.contains("1 damaged blob"),
            "{log}"
        );
        assert!(printed(&output).contains("11 blobs"), "{output:?}");
        assert!(out.join("checkpoint").is_file());
    }
    // A backup that lacks a blob does not count.
    assert_eq!(folder::read_backed_up(&dir), recorded);
}

#[test]
fn an_entry_is_proven_offline() {
    let scratch = tempfile::tempdir().unwrap();
    let proof = scratch.path().join("entry.tlog-proof");
    let key = prints(&["ledger", "vkey", LEDGER]);
    let key = key.trim();
    prints(&["audit", "prove", LEDGER, "3", "--out", text(&proof)]);
    let reported = prints(&["audit", "verify-proof", text(&proof), "--log-key", key]);
    assert!(reported.contains("VERIFIED"), "{reported}");
    // The proof is refused when the policy asks for a witness that has not cosigned, and when the proof is changed.
    let other = scratch.path().join("w.key");
    let witness = prints(&[
        "witness",
        "keygen",
        text(&other),
        "--name",
        "witness.example/w",
    ]);
    let policy = scratch.path().join("policy");
    fs::write(&policy, format!("log {key}\nwitness W {witness}quorum W\n")).unwrap();
    let with_policy = [
        "audit",
        "verify-proof",
        text(&proof),
        "--witness-policy",
        text(&policy),
    ];
    fails(&with_policy, "of no witness of the policy");
    fs::write(&policy, format!("log {key}\nquorum none\n")).unwrap();
    prints(&with_policy);
    let changed = fs::read_to_string(&proof)
        .unwrap()
        .replacen("index 3", "index 2", 1);
    fs::write(&proof, changed).unwrap();
    fails(&with_policy, "does not show that entry 2 is in the tree");
    fails(
        &["audit", "prove", LEDGER, "100000"],
        "there is no entry 100000",
    );
}

#[test]
fn a_witness_is_made_and_served() {
    let scratch = tempfile::tempdir().unwrap();
    let (key, state) = (scratch.path().join("w.key"), scratch.path().join("state"));
    let name = "witness.example/w";
    let vkey = prints(&["witness", "keygen", text(&key), "--name", name]);
    assert!(vkey.starts_with("witness.example/w+"), "{vkey}");
    fails(
        &["witness", "keygen", text(&key), "--name", name],
        "an existing key is kept",
    );
    let unnamed = scratch.path().join("other.key");
    let wrong = ["witness", "keygen", text(&unnamed), "--name", "a b"];
    let reported = logged(&ends(2, zk0(&wrong)));
    assert!(
        reported.contains("cannot be the name of a key"),
        "{reported}"
    );
    assert!(!unnamed.exists());
    let log = prints(&["ledger", "vkey", LEDGER]);
    let serve = [
        "witness",
        "serve",
        text(&state),
        "--key",
        text(&key),
        "--name",
        name,
        "--log-key",
        log.trim(),
        "--listen",
        "127.0.0.1:0",
    ];
    let _serving = Serving::start(&serve);
    fails(&serve, "is running already");
    let wrong = [
        "witness",
        "serve",
        text(&state),
        "--key",
        text(&key),
        "--name",
        name,
        "--log-key",
        vkey.trim(),
    ];
    let reported = logged(&ends(2, zk0(&wrong)));
    assert!(reported.contains("that of a log"), "{reported}");
}

/// A ledger of two closed rounds whose claims were refused, its key file, and a file that no entry names.
fn to_prune(scratch: &Path) -> (PathBuf, PathBuf) {
    let (dir, key) = (scratch.join("ledger"), scratch.join("log.key"));
    fs::write(&key, "07".repeat(32)).unwrap();
    let mut made = Made::found(&dir, 1);
    made.round();
    made.round();
    made.ledger.blobs().put(b"nobody's").unwrap();
    (dir, key)
}

fn with<'a>(prune: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [prune, more].concat()
}

#[test]
fn pruning_says_what_goes_before_it_goes() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, key) = to_prune(scratch.path());
    let blobs = || fs::read_dir(dir.join("blobs/sha256")).unwrap().count();
    // The nodes of both rounds submitted the same three files.
    assert_eq!(blobs(), 4);
    let prune = ["ledger", "prune", text(&dir)];
    let older = ["--keep-rounds", "0", "--proofs-too"];
    let reported = prints(&with(&prune, &[&older[..], &["--dry-run"]].concat()));
    for line in [
        "closed       2 rounds",
        "delete       15 bytes, 3 proofs of rounds 0 to 1",
        "delete       8 bytes, 1 file that no entry names",
        "keep         0 blobs, 0 bytes",
        "afterwards   nobody can check the proofs of rounds 0 to 1",
        "sign         the log's operator has pruned the updates of rounds 0 to 1, the proofs of rounds 0 to 1 (signed about the first",
        "dry run      nothing was deleted",
    ] {
        assert!(reported.contains(line), "{line}: {reported}");
    }
    assert_eq!(blobs(), 4);
    // Without the key nobody deletes, nor with another key.
    ends(2, zk0(&prune));
    ends(
        2,
        zk0(&with(&prune, &["--key", text(&key), "--proofs-too"])),
    );
    let other = scratch.path().join("other.key");
    fs::write(&other, "08".repeat(32)).unwrap();
    fails(&with(&prune, &["--key", text(&other)]), "not the log key");
    assert_eq!(blobs(), 4);
    // Only what no audit reads.
    let reported = prints(&with(&prune, &["--key", text(&key)]));
    assert!(
        reported.contains("deleted      1 blob, 8 bytes"),
        "{reported}"
    );
    assert!(!reported.contains("sign"), "{reported}");
    assert_eq!(blobs(), 3);
    let audited = || ends(3, zk0(&["audit", "replay", text(&dir)]));
    let before = printed(&audited());
    assert!(!before.contains("pruned"), "{before}");
    let with_key = [&older[..], &["--key", text(&key)]].concat();
    let reported = prints(&with(&prune, &with_key));
    assert!(
        reported.contains("deleted      3 blobs, 15 bytes"),
        "{reported}"
    );
    assert_eq!(blobs(), 0);
    let after = printed(&audited());
    let line = "not checked  6 refusals' reasons: the log's operator has pruned what this needs; the first, the refused proof";
    assert!(after.contains(line), "{after}");
    let note = "note         the log's operator has pruned the updates of rounds 0 to 1, the proofs of rounds 0 to 1 (signed";
    assert!(after.contains(note), "{after}");
    // So does an aggregator that starts. This one ends at once, because the port of its log is in use.
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let log = taken.local_addr().unwrap().to_string();
    let serve = ["aggregator", "serve", text(&dir), "--key", text(&key)];
    let serve = [&serve[..], &["--listen", "127.0.0.1:0"]].concat();
    let repeated = "how the updates of rounds 0 to 1 were combined cannot be computed again";
    fails(&[&serve[..], &["--log-listen", &log]].concat(), repeated);
    // The six updates never were in this folder.
    let reported = prints(&["ledger", "fsck", text(&dir)]);
    let note = "12 such blobs are not in this folder";
    assert!(reported.contains(note), "{reported}");
}

#[test]
fn nobody_prunes_a_ledger_that_is_in_use() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, key) = to_prune(scratch.path());
    let writer = Ledger::open(&dir, None, SigningKey::from_bytes(&[7; 32])).unwrap();
    let prune = ["ledger", "prune", text(&dir), "--key", text(&key)];
    fails(
        &prune,
        "is in use by another process: stop that process first",
    );
    // Looking is allowed.
    let reported = prints(&["ledger", "prune", text(&dir), "--dry-run"]);
    assert!(
        reported.contains("1 file that no entry names"),
        "{reported}"
    );
    drop(writer);
    let reported = prints(&prune);
    assert!(
        reported.contains("deleted      1 blob, 8 bytes"),
        "{reported}"
    );
}

#[test]
fn many_files_that_no_entry_names_are_not_pruned_without_yes() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, key) = to_prune(scratch.path());
    let blobs = Blobs::at(&dir);
    let stranger = |number: u8| blobs.put(&[number]).unwrap();
    let strangers: Vec<_> = (0..10).map(stranger).collect();
    let prune = ["ledger", "prune", text(&dir), "--key", text(&key)];
    // With the one that was there, they are eleven.
    fails(
        &prune,
        "no entry of this ledger names 11 files, 18 bytes, which would be deleted",
    );
    assert!(strangers.iter().all(|blob| blobs.contains(blob)));
    prints(&["ledger", "prune", text(&dir), "--dry-run"]);
    let reported = prints(&with(&prune, &["--yes"]));
    assert!(reported.contains("deleted      11 blobs"), "{reported}");
    for number in 0..10 {
        stranger(number);
    }
    let reported = prints(&prune);
    assert!(reported.contains("deleted      10 blobs"), "{reported}");
}
