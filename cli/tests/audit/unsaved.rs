//! Audits whose state file cannot be written. They pass no verdict on: the next audit would not notice a rollback.

use super::ends;
use crate::harness::made_ledger::Made;
use crate::harness::{copy, text};
use ed25519_dalek::SigningKey;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use zk0_audit::log_source::Trust;
use zk0_audit::watch::{LogWatch, Look, WatchOptions};
use zk0_audit::{Depth, TrustedPrograms};
use zk0_ledger::Ledger;

/// A name that a file can have, but a temporary file beside it cannot: it gets a longer one.
fn unwritable(folder: &Path) -> PathBuf {
    folder.join("s".repeat(250))
}

#[test]
fn an_audit_whose_state_cannot_be_saved_says_so_and_does_not_pass() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, state) = (scratch.path().join("ledger"), unwritable(scratch.path()));
    drop(Made::found(&dir, 0).ledger);
    let replay = ["audit", "replay", text(&dir), "--state", text(&state)];
    let (reported, why) = ends(4, &replay);
    assert!(
        reported.contains("INCOMPLETE"),
        "the report is there: {reported}"
    );
    assert!(reported.contains("cannot be saved"), "{reported}");
    assert!(why.contains("name another file with --state"), "{why}");
    let watch = ["audit", "watch", text(&dir), "--state", text(&state)];
    let once = ["--looks", "1", "--interval", "1"];
    let (reported, why) = ends(4, &[&watch[..], &once].concat());
    assert!(reported.contains("incomplete   7 entries"), "{reported}");
    assert!(
        why.contains("gave no verdict") && why.contains("cannot be saved"),
        "{why}"
    );
    // Without the folder, no audit begins.
    let nowhere = scratch.path().join("nowhere/state");
    for (state, words) in [
        (nowhere.as_path(), "there is no folder"),
        (scratch.path(), "this is a folder"),
    ] {
        for command in ["replay", "watch"] {
            let begin = ["audit", command, text(&dir), "--state", text(state)];
            let (reported, why) = ends(2, &begin);
            assert!(
                reported.is_empty() && why.contains(words),
                "{reported}{why}"
            );
        }
    }
}

const HOUR: Duration = Duration::from_secs(3600);

/// What a watch finds in a log that is replaced by an older copy between two looks, and may be behind for this time. `lose` is called in between.
fn replaced(
    state: &Path,
    behind_for: Duration,
    lose: impl Fn(&Path),
) -> (anyhow::Result<Look>, Look) {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, older) = (scratch.path().join("ledger"), scratch.path().join("older"));
    drop(Made::found(&dir, 0).ledger);
    copy(&dir, &older);
    let ledger = Ledger::open(&dir, None, SigningKey::from_bytes(&[7; 32])).unwrap();
    let mut made = Made {
        time_ms: ledger.state().time_ms(),
        ledger,
        seed: 0,
        lie: None,
    };
    made.round();
    drop(made.ledger);
    let mut watch = LogWatch::begin(WatchOptions {
        ledger: text(&dir).into(),
        trust: Trust::default(),
        depth: Depth::Light,
        named: TrustedPrograms::default(),
        state: Some(state.into()),
        mirror: None,
        behind_for,
    })
    .unwrap();
    let first = watch.look(None, |_| {});
    lose(state);
    fs::remove_dir_all(&dir).unwrap();
    fs::rename(&older, &dir).unwrap();
    (first, watch.look(None, |_| {}).unwrap())
}

#[track_caller]
fn is_rolled_back(look: &Look) {
    match look {
        Look::Alarm(faults) => assert!(faults[0].starts_with("ROLLED BACK"), "{faults:?}"),
        other => panic!("the watch accepts an older copy: {other:?}"),
    }
}

#[test]
fn a_watch_whose_state_cannot_be_saved_gives_no_verdict_and_still_notices_a_rollback() {
    let scratch = tempfile::tempdir().unwrap();
    for behind_for in [Duration::ZERO, HOUR] {
        let (first, second) = replaced(&unwritable(scratch.path()), behind_for, |_| {});
        let why = first.unwrap_err().to_string();
        assert!(why.contains("cannot be saved"), "{why}");
        if behind_for == HOUR {
            assert!(matches!(second, Look::Behind(_)), "{second:?}");
        } else {
            is_rolled_back(&second);
        }
    }
}

#[test]
fn a_watch_whose_state_file_is_removed_still_notices_a_rollback() {
    let scratch = tempfile::tempdir().unwrap();
    let state = scratch.path().join("state");
    let (first, second) = replaced(&state, Duration::ZERO, |state| {
        fs::remove_file(state).unwrap();
    });
    assert_eq!(first.unwrap(), Look::Continues);
    is_rolled_back(&second);
    assert!(!state.exists(), "the older copy is not remembered");
}
