//! Event files: the bytes of TensorBoard's own writer, and runs that go on.

use std::fs;
use std::path::Path;
use zk0_node::tensorboard::event::{Event, VERSION};
use zk0_node::tensorboard::record::record;
use zk0_node::tensorboard::{EventFile, EventFileError};
use zk0_testkit::event_files::{curves, events, files, records};

/// `vectors/reference.py` wrote these with the package `tensorboard`.
#[test]
fn events_have_the_bytes_of_tensorboards_own_writer() {
    let path = "tests/tensorboard/vectors/reference.tfevents";
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let at = |seconds: f64| 1_700_000_000.0 + seconds;
    let ours = [
        Event::version(at(0.0)),
        Event::restart(at(0.25), 41),
        Event::scalars(at(0.5), 41, &[("train/loss", 0.75), ("train/lr", 1e-4)]),
        Event::scalars(at(1.5), 30_000, &[("train/grad_norm", 0.0)]),
        Event::scalars(at(2.5), 0, &[("eval/loss", f64::NAN)]),
    ];
    let file = fs::read(path).unwrap();
    let theirs = records(&file);
    let ours = ours.map(|event| event.bytes());
    // Their first event also states which program wrote it.
    assert!(theirs[0].starts_with(&ours[0]));
    assert_eq!(theirs[1..], ours[1..]);
    let framed: Vec<u8> = theirs.iter().flat_map(|data| record(data)).collect();
    assert!(framed == file);
}

#[test]
fn a_run_that_goes_on_replaces_the_steps_that_it_makes_again() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("curves");
    let file = EventFile::begin(&folder).unwrap();
    for step in 1..=3 {
        file.scalars(step, &[("train/loss", step as f64), ("train/lr", 0.5)]);
    }
    let file = EventFile::go_on(&folder).unwrap();
    for step in 3..=4 {
        file.scalars(step, &[("train/loss", 10.0 * step as f64)]);
    }
    let files = files(&folder);
    assert_eq!(files.len(), 2);
    let steps = |path| -> Vec<_> { events(path).iter().map(|event| event.step).collect() };
    assert_eq!(steps(&files[0]), [0, 1, 2, 3]);
    // The version, the restart, and two steps.
    assert_eq!(steps(&files[1]), [0, 3, 3, 4]);
    for file in &files {
        assert_eq!(events(file)[0].file_version.as_deref(), Some(VERSION));
    }
    let curves = curves(&folder);
    let loss: Vec<_> = curves["train/loss"].clone().into_iter().collect();
    assert_eq!(loss, [(1, 1.0), (2, 2.0), (3, 30.0), (4, 40.0)]);
}

#[test]
fn a_run_does_not_begin_among_the_curves_of_another() {
    let dir = tempfile::tempdir().unwrap();
    // A run that fails before its first step leaves a file without values.
    for _ in 0..3 {
        drop(EventFile::begin(dir.path()).unwrap());
    }
    let first = EventFile::begin(dir.path()).unwrap();
    assert_eq!(files(dir.path()).len(), 4);
    first.scalars(1, &[("train/loss", 1.0)]);
    let error = EventFile::begin(dir.path()).unwrap_err();
    assert!(matches!(error, EventFileError::OtherRun(_)), "{error}");
    assert!(error.to_string().contains(dir.path().to_str().unwrap()));
    assert_eq!(files(dir.path()).len(), 4);
}

/// TensorBoard reads files in the order of their names.
#[test]
fn a_later_file_has_a_later_name_though_the_clock_was_set_back() {
    let dir = tempfile::tempdir().unwrap();
    let future = dir.path().join("events.out.tfevents.9000000000.elsewhere");
    fs::write(
        &future,
        record(&Event::scalars(1.0, 7, &[("a", 1.0)]).bytes()),
    )
    .unwrap();
    let file = EventFile::go_on(dir.path()).unwrap();
    file.scalars(8, &[("a", 2.0)]);
    let files = files(dir.path());
    assert_eq!(files[0], future);
    assert!(files[1].ends_with("events.out.tfevents.9000000001.zk0"));
}

#[test]
fn a_folder_that_cannot_be_written_to_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    for open in [EventFile::begin, EventFile::go_on] {
        let error = open(&file).unwrap_err().to_string();
        assert!(error.contains(file.to_str().unwrap()), "{error}");
        assert!(error.contains("choose another folder"), "{error}");
    }
}
