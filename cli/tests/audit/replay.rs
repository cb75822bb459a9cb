//! `zk0 audit replay`, in full and light, from the beginning and with a state file.

use super::{ends, export, json, look};
use crate::harness::made_ledger::Made;
use crate::harness::{copy, text, LEDGER};
use ed25519_dalek::SigningKey;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use zk0_audit::verified_entries::verified_entries;
use zk0_circuits::Digest;
use zk0_ledger::store::Store;
use zk0_ledger::{folder, Blobs, Ledger};
use zk0_protocol::Body;

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
    let full = json(0, &["audit", "replay", LEDGER, "--json"]);
    assert_eq!(
        (&full["verdict"], &full["depth"]),
        (&"verified".into(), &"full".into())
    );
    assert!(full["checked"]["proofs"].as_u64() >= Some(1));
    let light = [
        "audit",
        "replay",
        text(&out),
        "--light",
        "--json",
        "--mirror",
        text(&kept),
    ];
    let light = json(3, &light);
    assert_eq!(
        (&light["verdict"], &light["depth"]),
        (&"incomplete".into(), &"light".into())
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
        json(3, &["audit", "replay", LEDGER, "--light", "--json"]),
        light
    );
    let (reported, _) = ends(3, &["audit", "replay", LEDGER, "--light"]);
    assert!(
        reported.contains("INCOMPLETE   light audit: weights not verified"),
        "{reported}"
    );
    assert!(reported.contains("this audit is light"), "{reported}");
    let folder = ends(2, &["audit", "replay", LEDGER, "--mirror", text(&kept)]).1;
    assert!(folder.contains("--mirror is for an export"), "{folder}");
}

#[test]
fn each_verdict_has_an_exit_code_of_its_own() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let verdict = |code, ledger: &Path, words: &str| {
        let (reported, _) = ends(code, &["audit", "replay", text(ledger)]);
        assert!(reported.contains(words), "{reported}");
    };
    verdict(0, Path::new(LEDGER), "VERIFIED");
    let without = |name: &str, wanted: fn(&Body) -> Option<Digest>| {
        copy(Path::new(LEDGER), &place(name));
        let (entries, _) = verified_entries(Path::new(LEDGER)).unwrap();
        let blob = entries.iter().find_map(|entry| wanted(&entry.body));
        fs::remove_file(Blobs::at(&place(name)).path(&blob.unwrap())).unwrap();
        place(name)
    };
    // An update that counted is withheld.
    let update = without("update", |body| match body {
        Body::ContributionAccepted(signed) => Some(signed.statement.claim.terms.update.blob),
        _ => None,
    });
    verdict(1, &update, "is missing, and the round has closed");
    let list = without("list", |body| match body {
        Body::DatasetCommitted(signed) => Some(signed.statement.leaves),
        _ => None,
    });
    verdict(3, &list, "not checked  1 dataset's list of drawn frames");
    let (_, error) = ends(4, &["audit", "replay", text(&place("nothing"))]);
    assert!(error.contains("nothing"), "{error}");
    // The aggregator was killed after it had committed entries and before it published their checkpoint.
    let killed = place("killed");
    let mut made = Made::found(&killed, 0);
    let before = fs::read(folder::checkpoint(&killed)).unwrap();
    made.round();
    drop(made.ledger);
    fs::write(folder::checkpoint(&killed), &before).unwrap();
    let (_, error) = ends(4, &["audit", "replay", text(&killed)]);
    assert!(error.contains("start it once"), "{error}");
    // A checkpoint that the database never had is a fault.
    let stranger = place("stranger");
    drop(Made::found_with(&stranger, 0, [10; 32], String::new()).ledger);
    fs::copy(folder::checkpoint(&stranger), folder::checkpoint(&killed)).unwrap();
    verdict(1, &killed, "holds a checkpoint of 7 entries");
    // The program that the network proves with is not the one that this auditor names, but it is this release's.
    let option = ["audit", "replay", LEDGER, "--program", "00"];
    ends(0, &option);
}

#[test]
fn the_first_audit_into_a_mirror_may_name_the_network() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (out, mirror) = (place("out"), place("mirror"));
    export(Path::new(LEDGER), &out);
    let shown = json(0, &["audit", "show", LEDGER, "--json"]);
    let network = shown["network"]["id"].as_str().unwrap();
    let replay = ["audit", "replay", text(&out), "--mirror", text(&mirror)];
    let named = ["--network", network];
    for _ in 0..2 {
        ends(0, &[&replay[..], &named].concat());
    }
}

#[test]
fn the_auditors_own_disk_is_not_taken_for_the_ledger() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (out, mirror) = (place("out"), place("mirror"));
    export(Path::new(LEDGER), &out);
    let replay = ["audit", "replay", text(&out), "--mirror", text(&mirror)];
    ends(0, &replay);
    // A blob of the mirror is damaged. Nobody asks its owner to mend it.
    let mut blobs = fs::read_dir(mirror.join("blobs/sha256")).unwrap();
    let blob = blobs.next().unwrap().unwrap().path();
    let whole = fs::read(&blob).unwrap();
    fs::write(&blob, b"changed").unwrap();
    let (_, log) = ends(0, &replay);
    assert!(log.contains("is damaged, and is fetched again"), "{log}");
    assert_eq!(fs::read(&blob).unwrap(), whole);
    fs::write(&blob, b"changed").unwrap();
    let reported = look(0, &out, &place("state"), &["--mirror", text(&mirror)]);
    assert!(reported.contains("verified"), "{reported}");
    assert_eq!(fs::read(&blob).unwrap(), whole);
    // A file of the ledger cannot be read.
    let ledger = place("ledger");
    copy(Path::new(LEDGER), &ledger);
    let blob = ledger.join("blobs/sha256").join(blob.file_name().unwrap());
    fs::remove_file(&blob).unwrap();
    fs::create_dir(&blob).unwrap();
    let (_, error) = ends(4, &["audit", "replay", text(&ledger)]);
    assert!(error.contains("there is no verdict"), "{error}");
    fs::remove_dir(&blob).unwrap();
    fs::write(&blob, whole).unwrap();
    fs::create_dir(ledger.join("pruned")).unwrap();
    let (_, error) = ends(4, &["audit", "replay", text(&ledger)]);
    assert!(error.contains("there is no verdict"), "{error}");
    let (_, error) = ends(1, &["audit", "show", text(&ledger)]);
    assert!(error.contains("cannot be read to its end"), "{error}");
    let watch = ["audit", "watch", text(&ledger), "--looks", "1"];
    let (reported, error) = ends(4, &watch);
    assert!(!reported.contains("ALARM"), "{reported}");
    assert!(error.contains("there is no verdict"), "{error}");
    // An import was killed before it wrote an entry.
    let begun = place("begun");
    fs::create_dir(&begun).unwrap();
    drop(Store::open(&folder::database(&begun)).unwrap());
    let (_, error) = ends(4, &["audit", "replay", text(&begun)]);
    assert!(error.contains("zk0 ledger import"), "{error}");
}

#[test]
fn an_audit_with_a_state_file_reads_what_is_new_and_ends_the_same() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, state) = (scratch.path().join("ledger"), scratch.path().join("state"));
    let mut made = Made::found(&dir, 0);
    made.round();
    drop(made.ledger);
    let replay = |ledger: &Path| {
        let options = ["--json", "--state", text(&state)];
        // The lists of the datasets are not at hand.
        json(
            3,
            &[&["audit", "replay", text(ledger)][..], &options].concat(),
        )
    };
    let whole = |ledger: &Path| json(3, &["audit", "replay", text(ledger), "--json"]);
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
    let (_, log) = ends(3, &["audit", "replay", text(&dir), "--state", text(&state)]);
    assert!(log.contains("27 entries were verified before"), "{log}");
    // An older copy is behind, and there is no verdict. When its time is over, the log was rolled back. Another history is a fork at once. The state
    // file stays the same.
    let older = ["audit", "replay", text(&older), "--state", text(&state)];
    let (reported, why) = ends(4, &older);
    assert!(
        reported.is_empty()
            && why.contains("the log is behind: it shows 17 entries, and 27 were seen"),
        "{reported}{why}"
    );
    let (reported, _) = ends(1, &[&older[..], &["--behind-for", "0"]].concat());
    assert!(
        reported.contains("ROLLED BACK") && reported.contains("FAILED"),
        "{reported}"
    );
    let options = ["--state", text(&state)];
    let replay = |ledger: &Path| {
        ends(
            1,
            &[&["audit", "replay", text(ledger)][..], &options].concat(),
        )
        .0
    };
    let fork = scratch.path().join("fork");
    let mut made = Made::found(&fork, 0x0c);
    (0..3).for_each(|_| made.round());
    drop(made.ledger);
    let reported = replay(&fork);
    assert!(reported.contains("FORKED"), "{reported}");
    let stranger = scratch.path().join("stranger");
    drop(Made::found_with(&stranger, 0, [10; 32], String::new()).ledger);
    // The ledger of another network is no continuation, and no verdict is due.
    let kept = fs::read(&state).unwrap();
    let (reported, why) = ends(
        2,
        &["audit", "replay", text(&stranger), "--state", text(&state)],
    );
    assert!(
        reported.is_empty() && why.contains("Name another state file"),
        "{reported}{why}"
    );
    assert_eq!(fs::read(&state).unwrap(), kept);
    // A state file of another kind of audit, or a damaged one, cannot be used. The audit starts again and states it.
    let (reported, log) = ends(
        3,
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
    assert!(reported.contains("INCOMPLETE"), "{reported}");
    let mut bytes = fs::read(&state).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&state, bytes).unwrap();
    let (reported, log) = ends(3, &["audit", "replay", text(&dir), "--state", text(&state)]);
    assert!(log.contains("it is damaged"), "{log}");
    assert!(reported.contains("entries      27"), "{reported}");
}
