//! What the auditor mistypes is an error that says so. It is no fault of the ledger.

use crate::harness::made_ledger::Made;
use crate::harness::{text, LEDGER};
use crate::{ends, export};
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::thread;

#[test]
fn what_the_auditor_mistypes_gets_no_verdict() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (out, missing, kept) = (place("out"), place("missing"), place("kept"));
    export(Path::new(LEDGER), &out);
    let (elsewhere, page) = ("00".repeat(32), missing.join("page.html"));
    let (missing, there) = (text(&missing), place("page.html"));
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
        ] {
            let arguments = [&["audit", "replay", ledger][..], options].concat();
            let (said, log) = ends(2, &arguments);
            assert!(log.contains(why), "{arguments:?}: {log}");
            assert!(said.is_empty() && !log.contains("FAILED"), "{said}{log}");
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
    let (said, why) = ends(4, &[&watch[..], &once].concat());
    assert!(why.contains("is neither a directory nor"), "{said}{why}");
    assert!(!why.contains("is repeated"), "{why}");
}

#[test]
fn the_aggregators_own_port_is_told_from_a_log() {
    let scratch = tempfile::tempdir().unwrap();
    let dir = scratch.path().join("ledger");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            assert!(stream.read(&mut [0; 1 << 12]).unwrap() > 0);
            // A server of HTTP/2 begins with its settings.
            stream.write_all(&[0, 0, 0, 4, 0, 0, 0, 0, 0]).unwrap();
        }
    });
    for (code, arguments) in [
        (4, &["audit", "replay", &address][..]),
        (1, &["ledger", "import", &address, text(&dir)][..]),
    ] {
        let (_, why) = ends(code, arguments);
        assert!(why.contains("--log-listen"), "{arguments:?}: {why}");
    }
}
