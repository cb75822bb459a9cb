//! The cosignatures that an audit asks for.

use super::{ends, export, look};
use crate::harness::made_ledger::Made;
use crate::harness::{prints, text};
use ed25519_dalek::SigningKey;
use std::fs;
use zk0_ledger::folder;
use zk0_protocol::tlog::checkpoint::Parsed;
use zk0_protocol::tlog::cosigner::Cosigner;

#[test]
fn a_watch_asks_for_the_witnesses_that_it_was_told() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (dir, out, policy) = (place("ledger"), place("out"), place("policy"));
    drop(Made::found(&dir, 0).ledger);
    export(&dir, &out);
    let witness = prints(&[
        "witness",
        "keygen",
        text(&place("w.key")),
        "--name",
        "witness.example/w",
    ]);
    fs::write(&policy, format!("witness W {witness}quorum W\n")).unwrap();
    for log in [&out, &dir] {
        let reported = look(
            1,
            log,
            &place("state"),
            &["--witness-policy", text(&policy)],
        );
        assert!(
            reported.contains("ALARM") && reported.contains("of no witness of the policy"),
            "{reported}"
        );
    }
}

/// Whoever reads the published log notices that cosignatures are missing, without any option.
#[test]
fn the_networks_own_rules_ask_for_witnesses() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (dir, out) = (place("ledger"), place("out"));
    let cosigner = Cosigner::new("witness.example/w", SigningKey::from_bytes(&[55; 32])).unwrap();
    let policy = format!(
        "witness W {} http://127.0.0.1:1\nquorum W\n",
        cosigner.key()
    );
    drop(Made::found_with(&dir, 0, [9; 32], policy).ledger);
    // Without cosignatures, no command publishes anything from the folder.
    for arguments in [
        &["ledger", "export", text(&dir), text(&out)][..],
        &["ledger", "import", text(&dir), text(&place("copy"))],
        &["audit", "prove", text(&dir), "0"],
    ] {
        let (_, why) = ends(1, arguments);
        assert!(
            why.contains("before the witnesses have cosigned"),
            "{arguments:?}: {why}"
        );
    }
    // An audit of the folder itself is possible, and the report states that it did not look at cosignatures.
    let (reported, _) = ends(3, &["audit", "replay", text(&dir)]);
    assert!(
        reported.contains("cosignatures were not looked at"),
        "{reported}"
    );
    let signed = folder::read_checkpoint(&dir).unwrap().unwrap();
    let parsed = Parsed::read(&signed).unwrap();
    let cosignature = cosigner.cosign(parsed.note.text(), 1_700_000_000);
    folder::write_cosigned(&dir, &[&signed[..], &cosignature].concat()).unwrap();
    export(&dir, &out);
    let (reported, _) = ends(3, &["audit", "replay", text(&out)]);
    assert!(!reported.contains("cosignatures were not"), "{reported}");
    prints(&["ledger", "import", text(&out), text(&place("copy"))]);
    look(0, &out, &place("state"), &[]);
    // A published log without its cosignatures is refused, unless the user allows it.
    fs::write(out.join("checkpoint"), &signed).unwrap();
    for arguments in [
        &["audit", "replay", text(&out)][..],
        &["ledger", "import", text(&out), text(&place("copy"))],
        &["ledger", "import", text(&out), text(&place("fresh"))],
    ] {
        let (_, why) = ends(1, arguments);
        assert!(
            why.contains("lacks cosignatures that the network's rules require"),
            "{arguments:?}: {why}"
        );
    }
    let reported = look(1, &out, &place("state"), &[]);
    assert!(
        reported.contains("ALARM")
            && reported.contains("lacks cosignatures that the network's rules require"),
        "{reported}"
    );
    fs::write(place("any"), "quorum none\n").unwrap();
    let any = place("any");
    let allowed = [
        "audit",
        "replay",
        text(&out),
        "--witness-policy",
        text(&any),
    ];
    ends(3, &allowed);
    // The rules name the witnesses, so the operator may not name others.
    let key = place("log.key");
    fs::write(&key, format!("{}\n", "07".repeat(32))).unwrap();
    let (_, why) = ends(
        1,
        &[
            "aggregator",
            "serve",
            text(&dir),
            "--key",
            text(&key),
            "--witness-policy",
            text(&key),
        ],
    );
    assert!(why.contains("rules name its witnesses"), "{why}");
}
