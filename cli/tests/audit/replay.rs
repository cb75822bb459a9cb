//! `zk0 audit replay`, in full and light, from the beginning and with a state file.

use crate::harness::made_ledger::Made;
use crate::harness::{copy, json, prints, text, LEDGER};
use crate::{ends, export};
use ed25519_dalek::SigningKey;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use zk0_ledger::Ledger;

/// Names of the files in a folder.
fn names(dir: &Path) -> BTreeSet<String> {
    let name =
        |found: std::io::Result<fs::DirEntry>| found.unwrap().file_name().into_string().unwrap();
    fs::read_dir(dir).unwrap().map(name).collect()
}

#[test]
fn a_light_audit_fetches_no_weights_and_says_what_it_left_out() {
    let scratch = tempfile::tempdir().unwrap();
    let (out, kept) = (scratch.path().join("out"), scratch.path().join("kept"));
    export(Path::new(LEDGER), &out);
    let full = json(&["audit", "replay", LEDGER, "--json"]);
    assert_eq!(
        (&full["verdict"], &full["depth"]),
        (&"verified".into(), &"full".into())
    );
    assert!(full["checked"]["proofs"].as_u64() >= Some(1));
    let light = json(&[
        "audit",
        "replay",
        text(&out),
        "--light",
        "--json",
        "--mirror",
        text(&kept),
    ]);
    assert_eq!(
        (&light["verdict"], &light["depth"]),
        (&"verified".into(), &"light".into())
    );
    assert_eq!(light["checked"]["proofs"], full["checked"]["proofs"]);
    assert_eq!(light["checked"]["updates"], 0);
    assert!(light["not_checked"].as_array().unwrap().len() >= 4);
    let fetched = names(&kept.join("blobs/sha256"));
    let proofs = light["checked"]["proofs"].as_u64().unwrap()
        + light["checked"]["refusals"].as_u64().unwrap();
    assert_eq!(fetched.len() as u64, proofs, "{fetched:?}");
    assert!(fetched.len() < names(&out.join("blobs/sha256")).len());
    assert_eq!(
        json(&["audit", "replay", LEDGER, "--light", "--json"]),
        light
    );
    let said = prints(&["audit", "replay", LEDGER, "--light"]);
    assert!(
        said.contains("it did not read weights, so it checked no averages"),
        "{said}"
    );
    assert!(said.contains("this audit is light"), "{said}");
    let folder = ends(1, &["audit", "replay", LEDGER, "--mirror", text(&kept)]).1;
    assert!(folder.contains("--mirror is for an export"), "{folder}");
}

#[test]
fn an_audit_with_a_state_file_reads_what_is_new_and_ends_the_same() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, state) = (scratch.path().join("ledger"), scratch.path().join("state"));
    let mut made = Made::found(&dir, 0);
    made.round();
    drop(made.ledger);
    let replay = |ledger: &Path| {
        json(&[
            "audit",
            "replay",
            text(ledger),
            "--json",
            "--state",
            text(&state),
        ])
    };
    let whole = |ledger: &Path| json(&["audit", "replay", text(ledger), "--json"]);
    let older = scratch.path().join("older");
    copy(&dir, &older);
    assert_eq!(replay(&dir), whole(&dir));
    let key = SigningKey::from_bytes(&[7; 32]);
    let ledger = Ledger::open(&dir, None, key).unwrap();
    let time_ms = ledger.state().time_ms();
    let mut made = Made {
        ledger,
        time_ms,
        seed: 0x0f,
        lie: None,
    };
    made.round();
    drop(made.ledger);
    assert_eq!(replay(&dir), whole(&dir));
    let (_, log) = ends(0, &["audit", "replay", text(&dir), "--state", text(&state)]);
    assert!(log.contains("23 entries were verified before"), "{log}");
    // The audit reports an older copy and another history, and the state file stays the same.
    let options = ["--state", text(&state)];
    let replay = |ledger: &Path| {
        ends(
            1,
            &[&["audit", "replay", text(ledger)][..], &options].concat(),
        )
        .0
    };
    let said = replay(&older);
    assert!(
        said.contains("ROLLED BACK") && said.contains("FAILED"),
        "{said}"
    );
    let fork = scratch.path().join("fork");
    let mut made = Made::found(&fork, 0x0c);
    (0..3).for_each(|_| made.round());
    drop(made.ledger);
    let said = replay(&fork);
    assert!(said.contains("FORKED"), "{said}");
    let stranger = scratch.path().join("stranger");
    drop(Made::found_with(&stranger, 0, [10; 32], String::new()).ledger);
    let said = replay(&stranger);
    assert!(said.contains("is of network"), "{said}");
    // A state file of another kind of audit, or a damaged one, cannot be used. The audit starts again and says so.
    let (said, log) = ends(
        0,
        &[
            "audit",
            "replay",
            text(&dir),
            "--light",
            "--state",
            text(&state),
        ],
    );
    assert!(
        log.contains("the state file is from a full audit, and this audit is light"),
        "{log}"
    );
    assert!(said.contains("VERIFIED"), "{said}");
    let mut bytes = fs::read(&state).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&state, bytes).unwrap();
    let (said, log) = ends(0, &["audit", "replay", text(&dir), "--state", text(&state)]);
    assert!(log.contains("it is damaged"), "{log}");
    assert!(said.contains("entries      23"), "{said}");
}
