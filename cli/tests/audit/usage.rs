//! What the auditor mistypes is an error that states it. It is no fault of the ledger.

use super::{ends, export};
use crate::harness::made_ledger::Made;
use crate::harness::{prints, text, LEDGER, RECORDING};
use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::thread;
use zk0_node::recording::secret::Secrets;

#[test]
fn what_the_auditor_mistypes_gets_no_verdict() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (out, missing, kept) = (place("out"), place("missing"), place("kept"));
    export(Path::new(LEDGER), &out);
    let (elsewhere, page) = ("00".repeat(32), missing.join("page.html"));
    let (missing, there, data) = (text(&missing), place("page.html"), place("page.json"));
    for ledger in [LEDGER, text(&out)] {
        for (options, why) in [
            (&["--network", &elsewhere][..], "but --network names"),
            (&["--witness-policy", missing][..], "--witness-policy"),
            (&["--program", "zz"][..], "it is not hexadecimal"),
            (&["--html", text(&page)][..], "there is no folder"),
            (&["--html", text(scratch.path())][..], "this is a folder"),
            (
                &["--html", text(&there), "--rollouts", missing][..],
                "there is no such folder",
            ),
            (&["--html", text(&data)][..], "goes into"),
            (
                &["--html", text(&there), "--state", text(&data)][..],
                "is the file of --state",
            ),
            (
                &["--html", text(&there), "--state", text(&there)][..],
                "is the file of --state",
            ),
        ] {
            let arguments = [&["audit", "replay", ledger][..], options].concat();
            let (reported, log) = ends(2, &arguments);
            assert!(log.contains(why), "{arguments:?}: {log}");
            assert!(
                reported.is_empty() && !log.contains("FAILED"),
                "{reported}{log}"
            );
        }
    }
    // The auditor names the network of neither the mirror nor the log.
    let replay = |code, ledger: &Path, more: &[&str]| {
        let mirror = ["--light", "--mirror", text(&kept)];
        let begin = ["audit", "replay", text(ledger)];
        ends(code, &[&begin[..], &mirror, more].concat()).1
    };
    replay(3, &out, &[]);
    let log = replay(2, &out, &["--network", &elsewhere]);
    assert!(log.contains(&format!("{} is of network", text(&kept))));
    // Another ledger is served where the mirror's was: that is a fault.
    let (stranger, other) = (place("stranger"), place("other"));
    drop(Made::found(&stranger, 0).ledger);
    export(&stranger, &other);
    replay(1, &other, &[]);
}

#[test]
fn a_watch_does_not_wait_for_a_folder_that_is_not_there() {
    let watch = ["audit", "watch", "there-is-no-such-folder"];
    let once = ["--looks", "1", "--interval", "1"];
    let (reported, why) = ends(4, &[&watch[..], &once].concat());
    assert!(
        why.contains("is neither a directory nor"),
        "{reported}{why}"
    );
    assert!(!why.contains("is repeated"), "{why}");
}

#[test]
fn the_aggregators_own_port_is_told_from_a_log() {
    let scratch = tempfile::tempdir().unwrap();
    let dir = scratch.path().join("ledger");
    // A server of HTTP/2 begins with its settings.
    let address = answers(vec![0, 0, 0, 4, 0, 0, 0, 0, 0]);
    for (code, arguments) in [
        (4, &["audit", "replay", &address][..]),
        (1, &["ledger", "import", &address, text(&dir)][..]),
    ] {
        let (_, why) = ends(code, arguments);
        assert!(why.contains("--log-listen"), "{arguments:?}: {why}");
    }
}

/// A server that answers each request with these bytes, whatever it is for. Returns its address.
fn answers(bytes: Vec<u8>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            assert!(stream.read(&mut [0; 1 << 12]).unwrap() > 0);
            stream.write_all(&bytes).unwrap();
        }
    });
    address
}

#[test]
fn a_page_for_browsers_is_no_log_but_a_checkpoint_of_another_log_is_a_fault() {
    let page = "<!doctype html>\n<html><body>Welcome</body></html>\n";
    let more = "content-type: text/html\r\nconnection: close";
    let head = format!(
        "HTTP/1.1 200 OK\r\ncontent-length: {}\r\n{more}\r\n\r\n",
        page.len()
    );
    let address = answers((head + page).into_bytes());
    let (reported, why) = ends(4, &["audit", "replay", &address]);
    assert!(why.contains("this is not a signed note"), "{why}");
    assert!(reported.is_empty(), "{reported}");
    let once = ["--looks", "1", "--interval", "1"];
    let (reported, _) = ends(4, &[&["audit", "watch", &address][..], &once].concat());
    assert!(reported.is_empty(), "{reported}");
    // A signed note with another name or signature states that somebody has changed the log.
    let scratch = tempfile::tempdir().unwrap();
    let (dir, out) = (scratch.path().join("ledger"), scratch.path().join("out"));
    drop(Made::found(&dir, 0).ledger);
    export(&dir, &out);
    let signed = fs::read_to_string(out.join("checkpoint")).unwrap();
    let (origin, rest) = signed.split_once('\n').unwrap();
    let (mut resigned, mut damaged) = (signed.clone().into_bytes(), signed.clone().into_bytes());
    let at = signed.len() - 20;
    resigned[at] = if resigned[at] == b'A' { b'B' } else { b'A' };
    damaged[at] = b'!';
    let renamed = format!("{origin}x\n{rest}").into_bytes();
    for forged in [renamed, resigned, damaged] {
        fs::write(out.join("checkpoint"), forged).unwrap();
        ends(1, &["audit", "replay", text(&out)]);
        let watch = ["audit", "watch", text(&out)];
        let (reported, _) = ends(1, &[&watch[..], &once].concat());
        assert!(reported.contains("ALARM"), "{reported}");
    }
}

#[test]
fn what_cannot_be_read_gets_no_verdict_on_proofs_and_recordings() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (missing, garbage, secret) = (place("missing"), place("garbage"), place("secret"));
    fs::write(&garbage, "not a proof").unwrap();
    fs::write(&secret, Secrets::default().encode()).unwrap();
    let key = prints(&["ledger", "vkey", LEDGER]);
    let file = place("w.key");
    let keygen = ["witness", "keygen", text(&file), "--name"];
    let witness = prints(&[&keygen[..], &["witness.example/w"]].concat());
    let verify = |code, file: &Path, more: &[&str]| {
        let begin = ["audit", "verify-proof", text(file)];
        ends(code, &[&begin[..], more].concat())
    };
    verify(4, &missing, &["--log-key", key.trim()]);
    verify(2, &garbage, &["--log-key", witness.trim()]);
    verify(2, &garbage, &["--witness-policy", text(&missing)]);
    let (reported, _) = verify(1, &garbage, &["--log-key", key.trim()]);
    assert!(reported.contains("FAILED"), "{reported}");
    let recording = |code, ledger: &str, secret: &Path, words: &str| {
        let begin = ["audit", "recording", ledger, "--entry", "0"];
        let more = ["--recording", RECORDING, "--secret", text(secret)];
        let (reported, why) = ends(code, &[&begin[..], &more].concat());
        assert!(
            reported.is_empty() && why.contains(words),
            "{reported}{why}"
        );
    };
    recording(4, text(&missing), &secret, "is neither a directory nor");
    recording(2, LEDGER, &missing, "--secret");
    recording(
        2,
        LEDGER,
        &garbage,
        "does not begin as a file of secrets does",
    );
    recording(2, LEDGER, &secret, "does not register a dataset");
}
