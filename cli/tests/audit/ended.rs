//! Audits that are told to end. They leave nothing of what they have fetched in the folder for temporary files.

use crate::harness::{text, zk0};
use std::fs;
use std::net::TcpListener;
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Stdio};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

#[test]
fn an_audit_that_is_told_to_end_removes_what_it_has_fetched() {
    // Nothing is ever answered here, so the audit waits.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let (sender, connected) = channel();
    thread::spawn(move || {
        for stream in listener.incoming() {
            if sender.send(stream).is_err() {
                break;
            }
        }
    });
    let scratch = tempfile::tempdir().unwrap();
    for (command, signal, number) in [
        ("replay", "-TERM", 15),
        ("watch", "-TERM", 15),
        ("watch", "-INT", 2),
    ] {
        let mut audit = zk0(&["audit", command, &address])
            .env("TMPDIR", text(scratch.path()))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let asked = connected.recv_timeout(Duration::from_secs(20));
        let there = fs::read_dir(scratch.path()).unwrap().count();
        let told = Command::new("kill")
            .args([signal, &audit.id().to_string()])
            .status();
        assert!(told.unwrap().success());
        let ended = audit.wait().unwrap();
        assert!(asked.is_ok(), "{command} asks for the log");
        assert_eq!(there, 1, "{command} fetches into a temporary folder");
        assert_eq!(ended.signal(), Some(number), "{command} {signal}");
        let left = fs::read_dir(scratch.path()).unwrap();
        assert_eq!(left.count(), 0, "{command} {signal}");
    }
}
