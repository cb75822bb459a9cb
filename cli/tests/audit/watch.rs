//! `zk0 audit watch`.

use super::{ends, export, look};
use crate::harness::made_ledger::Made;
use crate::harness::text;
use std::fs;
use std::path::PathBuf;
use zk0_protocol::RefusalCode;

#[test]
fn a_watch_tells_what_is_new_and_remembers_what_it_saw() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (dir, state) = (place("ledger"), place("state"));
    let mut made = Made::found(&dir, 0);
    made.round();
    let export_as = |name: &str| -> PathBuf {
        let out = place(name);
        export(&dir, &out);
        out
    };
    let first = export_as("first");
    let reported = look(0, &first, &state, &[]);
    assert!(reported.contains("incomplete   17 entries"), "{reported}");
    assert_eq!(look(0, &first, &state, &[]), "", "nothing is new");
    made.round();
    drop(made.ledger);
    let second = export_as("second");
    let reported = look(0, &second, &state, &[]);
    assert_eq!(reported.lines().count(), 10, "{reported}");
    assert!(reported.contains("round 1 closed"), "{reported}");
    // The watch reads the ledger's own folder with the same state file.
    assert_eq!(look(0, &dir, &state, &[]), "");
    // A log that shows less is behind, which is no verdict.
    let kept = fs::read(&state).unwrap();
    let reported = look(4, &first, &state, &[]);
    assert!(
        reported.starts_with("behind       the log is behind"),
        "{reported}"
    );
    let reported = look(4, &first, &state, &["--json"]);
    let behind: serde_json::Value = serde_json::from_str(&reported).unwrap();
    assert_eq!(behind["event"], "behind");
    // One that stays behind, another history and damage raise an alarm, and the state file stays the same.
    let over = ["--behind-for", "0"];
    let reported = look(1, &first, &state, &over);
    assert!(
        reported.contains("ALARM") && reported.contains("ROLLED BACK"),
        "{reported}"
    );
    let reported = look(1, &first, &state, &["--json", "--behind-for", "0"]);
    let alarm: serde_json::Value = serde_json::from_str(&reported).unwrap();
    assert_eq!(alarm["event"], "alarm");
    let fault = alarm["text"].as_str().unwrap();
    assert!(fault.starts_with("ROLLED BACK"), "{fault}");
    let (forked, fork) = (place("forked"), place("fork"));
    let mut made = Made::found(&forked, 0x0c);
    (0..3).for_each(|_| made.round());
    drop(made.ledger);
    export(&forked, &fork);
    let reported = look(1, &fork, &state, &[]);
    assert!(
        reported.contains("ALARM") && reported.contains("FORKED"),
        "{reported}"
    );
    assert_eq!(fs::read(&state).unwrap(), kept);
    // A light watch checks everything again. What the full one saw has to stay all the same.
    let stranger = place("stranger");
    drop(Made::found_with(&stranger, 0, [10; 32], String::new()).ledger);
    for (log, words) in [
        (&first, "ROLLED BACK"),
        (&fork, "FORKED"),
        (&stranger, "is of network"),
    ] {
        let reported = look(1, log, &state, &["--light", "--behind-for", "0"]);
        assert!(
            reported.contains("ALARM") && reported.contains(words),
            "{reported}"
        );
        assert_eq!(fs::read(&state).unwrap(), kept);
    }
    assert_eq!(look(0, &second, &state, &["--light"]), "");
    assert_ne!(fs::read(&state).unwrap(), kept);
    // Another file lies under the name of a proof.
    let blobs = export_as("false-proof").join("blobs/sha256");
    let proof = fs::read_dir(blobs).unwrap().next().unwrap().unwrap();
    fs::write(proof.path(), b"another proof").unwrap();
    let reported = look(1, &place("false-proof"), &place("new"), &[]);
    assert!(
        reported.contains("ALARM") && reported.contains("SHA-256"),
        "{reported}"
    );
    // A mirror that is kept knows what the log has signed without the state file.
    let (mirror, other) = (place("mirror"), place("other"));
    look(0, &second, &other, &["--mirror", text(&mirror)]);
    fs::remove_file(&other).unwrap();
    let kept_mirror = ["--mirror", text(&mirror)];
    let reported = look(4, &first, &other, &kept_mirror);
    assert!(reported.contains("the log is behind"), "{reported}");
    let reported = look(1, &first, &other, &[&kept_mirror[..], &over].concat());
    assert!(reported.contains("ROLLED BACK"), "{reported}");
    // When the state file is damaged, its owner has to decide.
    let mut damaged = kept.clone();
    damaged[100] ^= 1;
    fs::write(&state, damaged).unwrap();
    let arguments = [
        "audit",
        "watch",
        text(&second),
        "--looks",
        "1",
        "--state",
        text(&state),
    ];
    let (_, why) = ends(4, &arguments);
    assert!(why.contains("remove it to start again"), "{why}");
    // If nobody answers, the watch raises no alarm, but it fails.
    fs::write(&state, kept).unwrap();
    let arguments = [
        "audit",
        "watch",
        "http://127.0.0.1:9",
        "--looks",
        "1",
        "--state",
        text(&state),
    ];
    let (reported, why) = ends(4, &arguments);
    assert!(
        !reported.contains("ALARM") && why.contains("gave no verdict"),
        "{reported}{why}"
    );
}

#[test]
fn an_alarm_has_a_line_for_each_fault() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, state) = (scratch.path().join("ledger"), scratch.path().join("state"));
    let mut made = Made::found(&dir, 0);
    // The proofs are none, but the aggregator states that two contributions are accepted.
    made.lie = Some(RefusalCode::InvalidProof);
    made.round();
    drop(made.ledger);
    let reported = look(1, &dir, &state, &[]);
    // The first line is that of the first look.
    let lines: Vec<_> = reported.lines().skip(1).collect();
    assert!(lines.len() > 1, "{reported}");
    for line in &lines {
        assert!(line.starts_with("ALARM        "), "{reported}");
        assert!(!line.contains("\\n"), "{reported}");
    }
    let reported = look(1, &dir, &scratch.path().join("other"), &["--json"]);
    let events = reported.lines().skip(1);
    let texts: Vec<_> = events
        .map(|line| {
            let event: serde_json::Value = serde_json::from_str(line).unwrap();
            assert_eq!(event["event"], "alarm");
            event["text"].as_str().unwrap().to_owned()
        })
        .collect();
    assert_eq!(texts.len(), lines.len(), "{reported}");
    assert!(!texts.concat().contains('\n'), "{reported}");
}
