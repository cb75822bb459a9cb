//! The disk is full while a run writes its curves. The run goes on, and the file stays one that can be read.
//!
//! The limit of a file's size stands for the full disk. It is of the whole process, so this test runs in one of its own.

use rlimit::Resource;
use std::fs;
use tokio::signal::unix::{signal, SignalKind};
use zk0_node::tensorboard::EventFile;
use zk0_testkit::event_files::{events, files};
use zk0_testkit::own_process::alone;

/// The signal that a process gets when a file would grow beyond the limit.
const SIGXFSZ: i32 = 25;

#[tokio::test]
async fn a_run_goes_on_and_its_file_can_be_read() {
    let name = "tensorboard::full_disk::a_run_goes_on_and_its_file_can_be_read";
    if !alone(name, &[]) {
        return;
    }
    // With a handler, the write fails, and the process goes on.
    let _ignored = signal(SignalKind::from_raw(SIGXFSZ)).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let file = EventFile::begin(dir.path()).unwrap();
    let write = |steps: std::ops::Range<u64>| {
        for step in steps {
            file.scalars(step, &[("train/loss", step as f64)]);
        }
    };
    write(0..10);
    let path = files(dir.path()).remove(0);
    let length = || fs::metadata(&path).unwrap().len();
    let before = length();
    let (soft, hard) = Resource::FSIZE.get().unwrap();
    // Room for one event and a half: the half stays behind.
    Resource::FSIZE.set(before + 80, hard).unwrap();
    write(10..14);
    assert_eq!(length(), before + 80);
    Resource::FSIZE.set(soft, hard).unwrap();
    write(14..16);
    let events = events(&path);
    let steps: Vec<_> = events[1..].iter().map(|event| event.step).collect();
    assert_eq!(steps, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 14, 15]);
}
